"""The paper's evaluation made anew, up to its table.

``stages`` measures and writes results, ``results`` reads them, and ``paper`` sets what the paper
prints beside them: ``Results.summary`` is the table, which ``figures/table.py`` draws.
"""
