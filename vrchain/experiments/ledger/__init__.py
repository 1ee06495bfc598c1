"""How fast, how large and how robust the ledger is.

``latency``: the paper's update and retrieval times. ``speed`` (``vrchain bench ledger``): beside
what hashing, signing and the disk take at least (``baselines``) for ledgers of up to 100,000
positions (``stores``). ``size``: over positions and robots. ``flood`` (``vrchain bench flood``):
while one robot floods the others' gate (``flooder``). ``tampering``: who notices it.
"""
