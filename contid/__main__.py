"""Entry point of ``python -m contid``."""

from contid.cli.main import main

if __name__ == "__main__":
    main()
