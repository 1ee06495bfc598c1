"""From the ledger to the goal: a chain of common landmarks, and the mission that drives it."""
