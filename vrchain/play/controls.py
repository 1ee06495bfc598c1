"""What a control is, what is shown for its value, and both in a notebook."""

import html
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from vrchain.errors import LearnedError, VRChainError
from vrchain.extras import require
from vrchain.plots.save import png_bytes

WIDTH_IN = 9.0  # of all that is shown here: its text is still read at 800 pixels
_WIDE = {"layout": {"width": "96%", "max_width": "820px"}, "style": {"description_width": "11em"}}


class PlayError(VRChainError):
    """A value that a control cannot have."""


@dataclass(frozen=True)
class Slider:
    """A number from low to high, in steps."""

    text: str
    low: float
    high: float
    step: float
    value: float

    def checked(self, name: str, value: Any) -> float:
        """The value; PlayError if the slider cannot have it."""
        number = isinstance(value, Real) and not isinstance(value, bool)
        if not number or not self.low <= value <= self.high:
            raise PlayError(f"expected {name} from {self.low:g} to {self.high:g}, got {value!r}")
        return value

    def widget(self) -> Any:
        """As ipywidgets has it; it tells once it is let go."""
        import ipywidgets

        whole = all(float(n).is_integer() for n in (self.low, self.high, self.step, self.value))
        kind, of = (ipywidgets.IntSlider, int) if whole else (ipywidgets.FloatSlider, float)
        return kind(
            value=of(self.value), min=of(self.low), max=of(self.high), step=of(self.step),
            description=self.text, continuous_update=False, **_WIDE,
        )  # fmt: skip


@dataclass(frozen=True)
class Choice:
    """One of some names; several, in a tuple, if ``several``."""

    text: str
    options: tuple[str, ...]
    value: str | tuple[str, ...]
    several: bool = False

    def checked(self, name: str, value: Any) -> Any:
        """The value; PlayError if there is no such option."""
        chosen = value if self.several and isinstance(value, tuple | list) else (value,)
        if wrong := [one for one in chosen if one not in self.options]:
            raise PlayError(f"expected {name} of {', '.join(self.options)}, got {wrong[0]!r}")
        return tuple(chosen) if self.several else value

    def widget(self) -> Any:
        """As ipywidgets has it."""
        import ipywidgets

        kind = ipywidgets.SelectMultiple if self.several else ipywidgets.Dropdown
        return kind(value=self.value, options=self.options, description=self.text, **_WIDE)


@dataclass(frozen=True, eq=False)
class Shown:
    """What is shown for some values: a sentence or more, a picture, and a table if there is one.

    highest: of sliders whose range depends on the other values.
    """

    says: str
    figure: Figure
    table: pd.DataFrame | None = None
    highest: Mapping[str, float] = field(default_factory=dict)

    def bundles(self) -> list[dict[str, Any]]:
        """As a notebook's outputs have it: the words, the picture, the table."""
        words = {"text/markdown": self.says, "text/plain": self.says}
        picture = {"image/png": png_bytes(self.figure), "text/plain": "a picture"}
        if self.table is None:
            return [words, picture, {"text/plain": ""}]
        wide = f'<div style="overflow-x: auto">{self.table.to_html()}</div>'
        return [words, picture, {"text/html": wide, "text/plain": self.table.to_string()}]


@dataclass(frozen=True, eq=False)
class Play:
    """Controls by name, and the function that draws what they show."""

    draw: Callable[..., Shown]
    controls: Mapping[str, Slider | Choice]

    def at(self, **values: Any) -> Shown:
        """What is shown for these values, and for the others as they stand at the start.

        PlayError names a control that there is not, or a value that it cannot have.
        """
        for name in values:
            if name not in self.controls:
                raise PlayError(f"expected controls of {', '.join(self.controls)}, got {name!r}")
        start = {name: control.value for name, control in self.controls.items()}
        given = {name: self.controls[name].checked(name, value) for name, value in values.items()}
        return self.draw(**{**start, **given})

    def _ipython_display_(self) -> None:
        from IPython.display import display

        try:
            require("ipywidgets", what="moving what is shown here")
            widgets = {name: control.widget() for name, control in self.controls.items()}
        except LearnedError as error:
            widgets, missing = {}, str(error)
        if widgets:
            import ipywidgets

            display(ipywidgets.VBox(list(widgets.values())))
        else:
            display({"text/plain": missing}, raw=True)
        slots = [display({"text/plain": ""}, raw=True, display_id=True) for _ in range(3)]

        def show(_: object = None) -> None:
            """Draw it; of what cannot be drawn, say why, and leave the picture as it was."""
            slots[0].update(_words("drawing …"), raw=True)
            try:
                shown = self.draw(**{name: widget.value for name, widget in widgets.items()})
            except VRChainError as error:
                slots[0].update(_words(f"{type(error).__name__}: {error}"), raw=True)
                return
            for name, highest in shown.highest.items():
                widgets[name].max = max(int(highest), 0)
            for slot, bundle in zip(slots, shown.bundles(), strict=True):
                slot.update(bundle, raw=True)

        for widget in widgets.values():
            widget.observe(show, names="value")
        if widgets:
            show()
        else:
            for slot, bundle in zip(slots, self.at().bundles(), strict=True):
                slot.update(bundle, raw=True)


def _words(text: str) -> dict[str, str]:
    return {"text/html": f"<p>{html.escape(text)}</p>", "text/plain": text}
