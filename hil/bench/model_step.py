"""A model as a C submodel: loading it, and a step of it through our interface and from C."""

import dataclasses
import time
from pathlib import Path

from segway_ecc.hil.bench.cache import own_cache
from segway_ecc.hil.case_study.offline import SUBMODEL_CART
from segway_ecc.node.native.cost import step_cost
from segway_ecc.node.native.library import NativeModel
from segway_ecc.node.native.load import load_native


def model_step() -> dict[str, float]:
    """Durations, s: of loading it the first time and from the cache, and of a step either way (medians)."""
    with own_cache():
        first_s, _ = _timed_load()
        again_s, model = _timed_load()
        return {"load_first_s": first_s, "load_from_cache_s": again_s, **dataclasses.asdict(step_cost(model))}


def _timed_load() -> tuple[float, NativeModel]:
    began_s = time.perf_counter()
    model = load_native(Path(SUBMODEL_CART.source))
    return time.perf_counter() - began_s, model
