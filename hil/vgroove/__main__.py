"""`python -m vgroove`: the command line."""

from vgroove.cli import main

main()
