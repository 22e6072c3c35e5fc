"""`python -m wiclosure` is `wiclosure`."""

from wiclosure.pipeline.cli import main

if __name__ == "__main__":
    main()
