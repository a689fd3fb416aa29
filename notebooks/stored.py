"""Notebooks as they are stored: run, clean of the machine, and still what a fresh run gives.

::

    python notebooks/stored.py compare build/notebooks    # a fresh run with what is stored
    python notebooks/stored.py store build/notebooks      # the fresh run takes its place

``make notebooks`` runs copies in ``build/notebooks`` and compares them.
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat

__all__ = ["NOTEBOOKS", "clean", "code_cells", "differences", "read", "stderr"]

NOTEBOOKS = sorted(Path(__file__).parent.glob("*.ipynb"))
_NUMBER = re.compile(r"[+-]?\d+(?:\.\d*)?(?:e[+-]?\d+)?")
_KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}


def read(path: Path) -> Any:
    """Read a notebook as it stands in its file."""
    return nbformat.read(path, as_version=nbformat.NO_CONVERT)


def code_cells(notebook: Any) -> list[Any]:
    """Return the cells with code."""
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def stderr(notebook: Any) -> str:
    """Return what went to stderr, such as warnings."""
    outputs = [output for cell in code_cells(notebook) for output in cell.outputs]
    return "".join(output.text for output in outputs if output.get("name") == "stderr")


def clean(notebook: Any) -> Any:
    """Return a notebook that has run without times, versions and states of the machine's."""
    notebook.metadata = nbformat.from_dict(
        {"kernelspec": _KERNEL, "language_info": {"name": "python"}}
    )
    for cell in notebook.cells:
        cell.metadata = nbformat.from_dict({})
    for number, cell in enumerate(code_cells(notebook), 1):
        cell.execution_count = number
        cell.outputs = list(_joined(cell.outputs))
        for output in cell.outputs:
            if "execution_count" in output:
                output.execution_count = number
            if "metadata" in output:
                output.metadata = nbformat.from_dict({})
    return notebook


def _joined(outputs: list[Any]) -> Iterator[Any]:
    """Join what was printed in several pieces, as the clock would have it."""
    last = None
    for output in outputs:
        if last is not None and last.get("name", "") == output.get("name"):
            last.text += output.text
            continue
        last = output
        yield output


def differences(stored: Any, fresh: Any) -> Iterator[str]:
    """Yield in what the outputs of two runs of one notebook differ.

    Words must be the same; a number may differ by one in the last digit that is shown, since
    another processor rounds otherwise. Of figures only that they are there is looked at.
    """
    for number, (old, new) in enumerate(zip(code_cells(stored), code_cells(fresh), strict=True), 1):
        if old.source != new.source:
            yield f"cell {number} is another"
        kinds = [[sorted(each.get("data", {})) for each in cell.outputs] for cell in (old, new)]
        if kinds[0] != kinds[1]:
            yield f"cell {number} shows other kinds of outputs"
        if not _is_same(_text(old), _text(new)):
            yield f"cell {number} says\n{_text(new)}\nand stored is\n{_text(old)}"


def _text(cell: Any) -> str:
    parts = (
        each.get("text") or each.get("data", {}).get("text/plain", "") for each in cell.outputs
    )
    return "\n".join(parts)


def _is_same(old: str, new: str) -> bool:
    if _NUMBER.sub("#", old) != _NUMBER.sub("#", new):
        return False
    pairs = zip(_NUMBER.findall(old), _NUMBER.findall(new), strict=True)
    return all(abs(float(a) - float(b)) <= 1.01 * _last_digit(a) for a, b in pairs if a != b)


def _last_digit(number: str) -> float:
    """Return what one in the last digit of a number is worth; nothing in a whole number."""
    mantissa, _, exponent = number.partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - decimals) if decimals else 0.0


def main(task: str, folder: Path) -> None:
    """Compare a fresh run with what is stored, or store it."""
    for path in NOTEBOOKS:
        fresh = clean(read(folder / path.name))
        if task == "store":
            nbformat.write(fresh, path)
            continue
        wrong = [*differences(read(path), fresh), *filter(None, [stderr(fresh)])]
        if wrong:
            sys.exit(f"{path.name}: {wrong[0]}\n(make notebooks stores nothing; see {__file__})")


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
