"""Entry point of ``python -m contid``."""

from contid.entry import main

if __name__ == "__main__":
    main()
