"""``python -m camrig`` and the command ``camrig``: the program."""

import sys

from ._camrig import main as _main


def main() -> None:
    """Run the program on the arguments of this process."""
    sys.exit(_main(["camrig", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
