"""From what was typed to a running service."""

import asyncio
import logging
import os
import sys
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import msgspec

from autonomy import app
from autonomy.config import Config, load_config
from autonomy.embedded import EmbeddedPx4
from autonomy.errors import ExitCode
from autonomy.patient_log import patient_log
from autonomy.service.api import Api
from autonomy.service.lock import Holder, VehicleLock, utc_now
from autonomy.service.metrics import Metrics
from autonomy.service.server import WebServer, access_of, listening_socket, url_of
from autonomy.service.station import Station
from autonomy.service.systemd import Notifier
from autonomy.serving.desk import Desk
from autonomy.serving.memory import settle
from autonomy.serving.parts import Parts, real_drivers
from autonomy.serving.preparing import load_kernels, start_embedded
from autonomy.serving.service import Service
from autonomy.simulation import with_scenario
from hal.sim.scenario import load_scenario

_LOG = logging.getLogger("autonomy")
_SWITCH_INTERVAL_S = 0.0005
"""How long the web's thread may keep the interpreter from the control loop."""


class ServeOptions(msgspec.Struct, frozen=True):
    """`autonomy serve` as it was typed. At most one of `scenario` and `connection` is given."""

    config_path: str | None = None
    scenario: str | None = None
    connection: str | None = None
    seed: int = 0
    host: str | None = None
    port: int | None = None
    log_dir: str | None = None


def serve(options: ServeOptions) -> int:
    """Run until told to stop; returns the exit code.

    Raises BadInput, DocumentError, PortInUse, VehicleHeld before anything is connected.
    """
    logging.getLogger("uvicorn").setLevel(logging.WARNING)
    config = _effective(options)
    access = access_of(config.service, os.environ)
    notifier = Notifier(os.environ)
    with ExitStack() as stack:
        stack.enter_context(patient_log())
        listening = listening_socket(config.service.host, config.service.port)
        stack.callback(listening.close)
        connection = options.connection or config.vehicle.connection
        if options.scenario is None:
            lock = VehicleLock(connection, Holder("autonomy serve", os.getpid(), utc_now()))
            stack.enter_context(lock)
            lock.reachable_at(url_of(listening))
        embedded: EmbeddedPx4 | None = None
        if options.scenario is not None:
            embedded = EmbeddedPx4(options.scenario, options.seed)
            stack.push(embedded)
            connection = embedded.connection
        config = config.model_copy(
            update={"vehicle": config.vehicle.model_copy(update={"connection": connection})}
        )
        desk = Desk(config, options.scenario, options.seed)
        station = Station(config, desk.check)
        desk.station = station
        metrics = Metrics(station)
        api = Api(
            station,
            metrics,
            access,
            log_folder=Path(config.log.directory),
            scenario=options.scenario,
        )
        stack.enter_context(WebServer(api.application(), listening))
        _LOG.info("listening on %s", url_of(listening))
        sys.setswitchinterval(_SWITCH_INTERVAL_S)
        parts = Parts(
            config,
            desk,
            station,
            metrics,
            notifier,
            real_drivers(config),
            true_clearance_m=embedded.true_clearance_m if embedded is not None else None,
            prepare=partial(_prepare, embedded),
        )
        asyncio.run(Service(parts).run())
    return int(ExitCode.GOAL_REACHED)


async def _prepare(embedded: EmbeddedPx4 | None, tell: Callable[[str], None]) -> None:
    await load_kernels(tell)
    if embedded is not None:
        await start_embedded(embedded, tell)
    settle()


def _effective(options: ServeOptions) -> Config:
    """The configuration with what was typed laid over it; raises DocumentError or BadInput."""
    config = load_config(Path(options.config_path) if options.config_path else None)
    typed = {"host": options.host, "port": options.port}
    service = {key: value for key, value in typed.items() if value is not None}
    changes: dict[str, object] = {"service": config.service.model_copy(update=service)}
    if options.log_dir is not None:
        changes["log"] = config.log.model_copy(update={"directory": options.log_dir})
    config = config.model_copy(update=changes)
    if options.scenario is not None:
        return with_scenario(config, load_scenario(options.scenario))
    app.check_connection(options.connection or config.vehicle.connection)
    return config
