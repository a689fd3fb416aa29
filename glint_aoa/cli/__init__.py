"""The command line: thin commands over the library."""


def main() -> None:
    """Run the program ``glint-aoa``."""
    from glint_aoa.cli.app import main as run

    run()


__all__ = ["main"]
