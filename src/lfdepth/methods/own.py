"""Names of lfdepth's own methods, and where they are at home."""

from __future__ import annotations

from typing import Any

DEFAULT = "fbs-vis"
"""The method that is used where none is named."""

_FAMILY = {
    "fbs": "lfdepth.methods.fbs:Fbs",
    "fbs-sfa": "lfdepth.methods.fbs_sfa:FbsSfa",
    "fbsocc-sfa": "lfdepth.methods.fbsocc_sfa:FbsoccSfa",
    "fbs-vis": "lfdepth.methods.fbs_vis:FbsVis",
}
_COMPARED = {
    "spo": "lfdepth.methods.spo:Spo",
    "spo-mo": "lfdepth.methods.spo_mo:SpoMo",
    "cae": "lfdepth.methods.cae:Cae",
    "lf-occ": "lfdepth.methods.lf_occ:LfOcc",
    "omg": "lfdepth.methods.omg:Omg",
    "ofsy": "lfdepth.methods.ofsy:Ofsy",
    "oavc": "lfdepth.methods.oavc:Oavc",
}

_LEARNED = {
    "epinet": "lfdepth.methods.epinet:Epinet",
    "epinet-s": "lfdepth.methods.epinet:EpinetS",
    "lfattnet": "lfdepth.methods.lfattnet:Lfattnet",
}

HOMES = {**_FAMILY, **_COMPARED, **_LEARNED}
"""Module and class by name."""

FAMILY: tuple[str, ...] = tuple(_FAMILY)
"""Names of the methods of foreground-background separation, oldest first."""

COMPARED: tuple[str, ...] = tuple(_COMPARED)
"""Names of the methods that they are compared with, in the order of the paper's table."""

NAMES: tuple[str, ...] = (*FAMILY, *COMPARED)
"""Names of all that take any grid of views and need no weights."""

LEARNED: tuple[str, ...] = tuple(_LEARNED)
"""Names of the learned systems."""

WITHOUT_WEIGHTS: tuple[str, ...] = ("epinet", "lfattnet")
"""Those whose weights do not come along."""

PRESETS: dict[str, dict[str, Any]] = {
    "paper-synthetic": {"step": 0.02, "skip": 7},
    "paper-real": {"step": 0.05, "skip": 5},
}
"""Parameters by the name of the paper's experiment; a method takes those that it has."""
