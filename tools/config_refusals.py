"""Documents whose keys contradict each other, one for every rule between keys."""

from typing import Any

_UP, _FRONT = {"name": "up", "pitch_deg": 90}, {"name": "front"}
_TOF = {"chip": "vl53l0x", "beam": "front"}
_LONG = {"chip": "vl53l1x", "beam": "front"}
_SHARP = {"chip": "gp2y0a21", "beam": "front"}
_BEHIND = {"mux_address": 0x70, "mux_channel": 0}
_LINE = {"xshut": "gpiochip0/17", "address": 0x30}


def _i2c(*sensors: dict[str, Any]) -> dict[str, Any]:
    return {"driver": "i2c", "sensors": list(sensors)}


def _beams(*drivers: dict[str, Any], mavlink: int = 1) -> dict[str, Any]:
    return {"beams": {"drivers": [*drivers, *[{"driver": "mavlink"}] * mavlink]}}


RULES: tuple[dict[str, Any], ...] = (
    {"map": {"corridor_hit_m": 0.15}},
    {"guidance": {"push_below_m": 0.18}},
    {"planner": {"hard_clearance_m": 0.03}},
    {"planner": {"hard_clearance_m": 0.16}},
    {"planner": {"storeys": {"spacing_m": 0.1}}},
    {"mission": {"altitude_m": 2.5}},
    {"guidance": {"speed_max_m_s": 0.3}},
    {"guidance": {"speed_max_m_s": 0.05}},
    {"guidance": {"slowest_at_m": 0.3}},
    {"guidance": {"yaw_rate_deg_s": 180}},
    {"failsafe": {"battery_land": 0.3}},
    {"failsafe": {"fence_land_m": 0.1}},
    {"guard": {"altitude_min_m": 2.0}},
    {"guard": {"fence": {"polygon_ne_m": None}}},
    {"guard": {"fence": {"polygon_ne_m": [[0, 0], [4, 4], [4, 0], [0, 4]]}}},
    {"guard": {"fence": {"polygon_ne_m": [[5, 5], [5, 6], [6, 6]], "radius_m": 2}}},
    {"gnss": {"driver": "serial", "port": "/dev/ttyUSB0", "reopen_after_s": 5}},
    {"beams": {"min_m": 1.0}},
    {"beams": {"mounts": [_UP]}},
    {"beams": {"mounts": [_FRONT, _FRONT]}},
    _beams(mavlink=2),
    _beams({"driver": "virtual", "scenario": "door"}),
    _beams(_i2c(_TOF), mavlink=0),
    _beams(_i2c({**_TOF, "beam": "tail"})),
    _beams(_i2c(_TOF | _BEHIND, _TOF | _BEHIND | {"mux_channel": 1})),
    _beams(_i2c(_TOF), _i2c({**_TOF, "beam": "back"})),
    _beams(_i2c({**_TOF, "budget_s": 0.2})),
    _beams(
        *(
            {
                "driver": "i2c",
                "bus": f"/dev/i2c-{bus}",
                "sensors": [{**_TOF, "beam": beam, "budget_s": 0.02}],
            }
            for bus, beam in enumerate(("front", "right", "back"))
        )
    ),
    _beams(_i2c({**_TOF, "mux_address": 0x70})),
    _beams(_i2c({**_TOF, "address": 0x30})),
    _beams(_i2c(_TOF, {**_TOF, "beam": "back"})),
    _beams(_i2c(_TOF | _LINE, {**_TOF, "beam": "back", **_LINE, "address": 0x31})),
    _beams(_i2c({**_TOF, **_LINE, "address": 0x70}, {**_SHARP, **_BEHIND, "beam": "back"})),
    _beams(_i2c({**_LONG, "budget_ms": 15, "mode": "long"})),
    _beams(_i2c({**_LONG, "roi_centre": 100})),
    _beams(
        _i2c(
            {
                **_SHARP,
                "curve": {"kind": "table", "points": [[0.8, 0.4], [0.1, 2.3]]},
            }
        )
    ),
)
