"""Python in notebooks and documents: what it imports, and which public names it uses."""

import ast
import re

import vrchain as vr

_BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(markdown: str) -> list[str]:
    """The Python blocks of a document."""
    return _BLOCK.findall(markdown)


def strangers(tree: ast.Module) -> list[str]:
    """What code uses of the package beside its public names, as ``import vrchain as vr``."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    found = [name for name in found if name.startswith("vrchain.")]
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            known = {
                "vr": vr.__all__,
                "vr.play": vr.play.__all__,
                "vr.plots": vr.plots.__all__,
            }.get(ast.unparse(node.value))
            if known is not None and node.attr not in known:
                found.append(ast.unparse(node))
    return found
