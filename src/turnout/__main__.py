"""Run the program with `python -m turnout`."""

from turnout.cli.main import main

if __name__ == "__main__":
    main()
