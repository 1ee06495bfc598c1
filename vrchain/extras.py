"""Libraries that are not installed unless asked for, and what to say where they are not."""

from importlib.util import find_spec

from vrchain.errors import LearnedError, VRChainError

_EXTRAS = {"nbconvert": "notebooks", "ipykernel": "notebooks"}  # the others: learned


def require(*libraries: str, what: str, error: type[VRChainError] = LearnedError) -> None:
    """Raise an error unless all these are installed; ``what``: that needs them."""
    for library in libraries:
        if find_spec(library) is None:
            extra = _EXTRAS.get(library, "learned")
            raise error(
                f"{what} needs {library}, but {library} is not installed: "
                f"pip install 'vrchain[{extra}]', or in a checkout as environment.md says"
            )
