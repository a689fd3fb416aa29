"""Files with some bytes changed and the end cut off, as drawn by hypothesis."""

from hypothesis import strategies as st

from glint_aoa.errors import RecordingError
from glint_aoa.records.formats import open_fields


def spoil(path, data, *, most=4, least=1):
    """Change up to `most` bytes, and keep `least` bytes or more of the file."""
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, most))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(least, len(content)))])


def complaint_about(path):
    """Read all fields; return what is said against it, or None if they are there."""
    try:
        stack = open_fields(path)
        assert stack.read(0, len(stack)).shape == stack.shape
    except RecordingError as error:
        return str(error)
    return None
