"""YAML as people write it by hand."""

from typing import Any

import yaml


class _Loader(yaml.SafeLoader):
    """Refuses a key that is there twice, of which PyYAML would silently take the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [key.value for key, _ in node.value]
        for k, (key, _) in enumerate(node.value):
            if key.value in keys[:k]:
                told = f"the key {key.value!r} is there twice"
                raise yaml.constructor.ConstructorError(None, None, told, key.start_mark)
        return super().construct_mapping(node, deep)


def load_yaml(text: str) -> Any:
    """What a YAML text says; yaml.YAMLError, also where a key is there twice.

    PyYAML raises ValueError, KeyError, OverflowError and RecursionError besides.
    """
    return yaml.load(text, Loader=_Loader)
