"""`python -m icpmodel` is the command line."""

from .cli.console import main

if __name__ == "__main__":
    main()
