"""``python -m vrchain``: the same as the command ``vrchain``."""

from vrchain.cli import main

main()
