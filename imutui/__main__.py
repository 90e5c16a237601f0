"""`python -m imutui`."""

from imutui.cli import main

if __name__ == "__main__":
    main()
