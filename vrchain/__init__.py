"""VRChain: visual homing for teams of robots that share what they see through a ledger.

Importing the package is cheap; heavy libraries load in the modules that use them.
"""

__version__ = "0.1.0"
