"""Names of lfdepth's own methods, and where they are at home."""

from __future__ import annotations

from typing import Any

DEFAULT = "fbs-vis"
"""The method that is used where none is named."""

HOMES = {
    "oavc": "lfdepth.methods.oavc:Oavc",
    "ofsy": "lfdepth.methods.ofsy:Ofsy",
    "cae": "lfdepth.methods.cae:Cae",
    "spo": "lfdepth.methods.spo:Spo",
    "spo-mo": "lfdepth.methods.spo_mo:SpoMo",
    "lf-occ": "lfdepth.methods.lf_occ:LfOcc",
    "omg": "lfdepth.methods.omg:Omg",
    "fbs": "lfdepth.methods.fbs:Fbs",
    "fbs-sfa": "lfdepth.methods.fbs_sfa:FbsSfa",
    "fbsocc-sfa": "lfdepth.methods.fbsocc_sfa:FbsoccSfa",
    "fbs-vis": "lfdepth.methods.fbs_vis:FbsVis",
}
"""Module and class by name."""

NAMES: tuple[str, ...] = tuple(HOMES)
"""Names, oldest first."""

PRESETS: dict[str, dict[str, Any]] = {
    "paper-synthetic": {"step": 0.02, "skip": 7},
    "paper-real": {"step": 0.05, "skip": 5},
}
"""Parameters by the name of the paper's experiment; a method takes those that it has."""
