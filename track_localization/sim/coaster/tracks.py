"""The built-in tracks, laid out, closed and banked."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np

from track_localization.sim.coaster.designs import DESIGNS
from track_localization.sim.coaster.layout import bank, close, lay, to_track
from track_localization.sim.coaster.ride_plan import Phase, RidePlan, Zone
from track_localization.track.track_file import TrackFile

TRACKS = tuple(DESIGNS)
"""Names of the built-in tracks."""


@dataclasses.dataclass(frozen=True)
class Track:
    """A track with the plan of its ride; the plan's ``line_height_m`` applies to the file."""

    name: str
    title: str
    file: TrackFile
    plan: RidePlan


@functools.cache
def built_in(name: str) -> Track:
    """Return a built-in track; raise KeyError for an unknown name."""
    design = DESIGNS[name]
    guess = np.array(design.guess)
    layout = close(design.build, guess) if len(guess) else lay(design.build(guess))
    plan = _rounded(design.plan(layout))
    banked, _ = bank(layout, plan, design.bank_share, design.most_bank_deg, design.bank_smooth_m)
    return Track(name, design.title, to_track(banked), plan)


def _rounded(plan: RidePlan) -> RidePlan:
    """Give zones and stops to the millimetre, as a plan's file holds them."""

    def tidy(entry: Zone | Phase) -> Any:
        changes = {
            f.name: round(getattr(entry, f.name), 3)
            for f in dataclasses.fields(entry)
            if f.name.endswith('_m')
        }
        return dataclasses.replace(entry, **changes)

    zones, phases = tuple(map(tidy, plan.zones)), tuple(map(tidy, plan.phases))
    return dataclasses.replace(plan, zones=zones, phases=phases)
