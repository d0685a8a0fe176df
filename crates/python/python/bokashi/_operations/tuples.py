"""What operations are given or return in several parts. Loaded where it is asked for: see `bokashi.__getattr__`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from .._given import Fragments


class Environment(NamedTuple):
    """Light from all sides: spherical harmonics `[9, 3]`, and mirror images `[6, S, S, 3]` from sharp to rough."""

    harmonics: Any
    levels: Sequence[Any]


class LensLayer(NamedTuple):
    """What a lens sees of one layer in depth: fragments, colours times alpha `[N, C]`, and distances `[N]`.

    `distance` is that of `eye_depth`. `alpha` `[N]` is how much of what lies behind is hidden; without it all.
    `slope` `[N, 2]` is that of `eye_depth_slope`; without it each fragment is blurred as if it faced the lens.
    """

    fragments: Fragments[Any]
    values: Any
    distance: Any
    alpha: Any = None
    slope: Any = None


# Pickles and `help` know them by where users find them.
Environment.__module__ = LensLayer.__module__ = "bokashi"
