"""Turns orders into missions."""

from dataclasses import dataclass

from autonomy import app
from autonomy.config import Config
from autonomy.geometry import Point
from autonomy.report import FlyOptions
from autonomy.service.contract import MissionOrder
from autonomy.service.station import Station
from hal.config import Fence
from hal.frames import ned_from_frd


@dataclass
class Desk:
    """Turns orders into missions. `check` runs on the web side, so nothing here is changed."""

    config: Config
    scenario: str | None
    seed: int = 0
    station: Station | None = None

    def check(self, order: MissionOrder) -> None:
        """Raise BadInput or DocumentError for an order that must not be flown."""
        instant = self.station.instant if self.station is not None else None
        point, yaw_rad = (0.0, 0.0), 0.0
        if instant is not None and instant.position is not None and instant.attitude is not None:
            local, origin = instant.position.position_ned_m, instant.origin_ned_m
            point = (local[0] - origin[0], local[1] - origin[1])
            yaw_rad = instant.attitude.yaw_rad
        self.mission(order, point, yaw_rad).route_ned_m(yaw_rad)

    def mission(self, order: MissionOrder, point: Point, yaw_rad: float) -> app.Mission:
        """The order as a mission in the service's frame; the vehicle stands at `point`."""
        goals = tuple(_goal(goal) for goal in order.goals)
        frame: str = order.frame
        if frame == "body":
            goals = tuple(_from_body(goal, point, yaw_rad) for goal in goals)
            frame = "ned"
        options = FlyOptions(
            goals=goals,
            frame=frame,
            altitude_m=order.altitude_m,
            land=order.land,
            time_limit_s=order.time_limit_s,
            mode=order.mode,
            scenario=self.scenario,
            connection=None if self.scenario is not None else self.config.vehicle.connection,
            seed=self.seed,
            log_dir=self.config.log.directory,
        )
        return app.prepare_with(self.config, options)


def _goal(goal: list[float]) -> tuple[float, float, float | None]:
    return (goal[0], goal[1], goal[2] if len(goal) == 3 else None)


def _from_body(
    goal: tuple[float, float, float | None], point: Point, yaw_rad: float
) -> tuple[float, float, float | None]:
    north, east, _ = ned_from_frd((goal[0], goal[1], 0.0), yaw_rad)
    return (point[0] + north, point[1] + east, goal[2])


def shifted(mission: app.Mission, offset: Point) -> app.Mission:
    """The mission for a pilot whose frame begins at `offset`: the fence stays where it is."""
    guard = mission.config.guard
    polygon = tuple((n - offset[0], e - offset[1]) for n, e in guard.fence.outline_ne_m)
    moved = guard.model_copy(update={"fence": Fence(polygon_ne_m=polygon)})
    return app.Mission(
        mission.options, mission.config.model_copy(update={"guard": moved}), mission.scenario
    )
