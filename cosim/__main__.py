"""``python -m cosim`` is ``formation``."""

from cosim.cli import entry

if __name__ == "__main__":
    entry()
