"""`python -m rmr`, the command `rmr` where no script is on the path."""

from rmr.cli import main

if __name__ == "__main__":
    main()
