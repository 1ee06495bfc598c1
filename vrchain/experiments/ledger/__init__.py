"""How fast, how large and how robust the ledger is.

``latency``: the paper's update and retrieval times. ``speed`` (``vrchain bench ledger``): beside
what hashing, signing and the disk take at least (``baselines``) for ledgers of up to 100,000
positions (``stores``). ``size``: over positions and robots. ``tampering``: who notices it.
Over servers (``vrchain bench cluster``): ``cluster`` how fast, ``failures`` what is lost,
``flood`` what a flood costs the others,
``hostile`` what attacks come to.
"""
