"""From the ledger to the goal: a chain of common landmarks, and the mission that drives it.

``mission`` drives it, follows routes (``following``) and gives up; ``planning`` makes the routes;
``goal`` recognises the goal and makes sure of it; ``driving`` gets there round what is in the way.
"""
