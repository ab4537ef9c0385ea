"""`autonomy fly` beside a running service: the mission is handed over, and looks the same.

The service flies; this process shows its progress and its report, and ends with its exit code.
"""

import contextlib
import os
import signal
from collections.abc import Iterator

import msgspec

from autonomy.errors import AutonomyError, BadInput
from autonomy.progress import Progress
from autonomy.report import FlightReport, FlyOptions
from autonomy.service.client import Client
from autonomy.service.contract import MissionOrder, MissionRecord
from autonomy.service.lock import Holder
from autonomy.termination import termination_signals


def hand_over(options: FlyOptions, holder: Holder, progress: Progress) -> FlightReport:
    """Let `holder` fly the mission; returns the report when it is over.

    The first Ctrl-C (or another of `termination_signals`) stops the mission, the second lands it,
    as if it were flown here; one that the service did not take is asked again by the next.
    Raises BadInput when the service refuses it, NoService when the service ends before the mission.
    """
    if holder.api is None:
        raise ValueError("this holder cannot be talked to")
    client = Client(holder.api, os.environ.get("AUTONOMY_TOKEN"))
    record = client.create(order_of(options))
    progress.note(f"handed to {holder}: mission {record.id}, flown with its configuration")
    if options.log_dir is not None or not options.log:
        progress.note("the service keeps the log, where it keeps them all: see its log.directory")
    with _interrupts(client, progress):
        for frame in client.follow(record.id):
            if frame.command is not None:
                progress.tick(frame.command)
            if frame.record is not None:
                record = frame.record
    return report_of(record)


def order_of(options: FlyOptions) -> MissionOrder:
    """What was typed, as an order; raises BadInput for what a service is not asked to do."""
    if options.beams is not None or options.send_beams:
        raise BadInput(
            "a service holds the vehicle, and flies it with its own range sensors: end it, or give "
            "it virtual beams in its configuration (beams.drivers)"
        )
    goals = tuple([value for value in goal if value is not None] for goal in options.goals)
    order = MissionOrder(
        goals=goals,
        frame=options.frame,  # type: ignore[arg-type]  # checked against the contract below
        altitude_m=options.altitude_m,
        land=options.land,
        time_limit_s=options.time_limit_s,
        mode=options.mode,  # type: ignore[arg-type]  # checked against the contract below
    )
    try:
        return msgspec.json.decode(msgspec.json.encode(order), type=MissionOrder)
    except msgspec.ValidationError as error:
        raise BadInput(f"the service that holds the vehicle does not take this: {error}") from None


def report_of(record: MissionRecord) -> FlightReport:
    """The report in a mission's record; raises BadInput when it never began."""
    if record.report is None:
        raise BadInput(f"the service did not fly mission {record.id}: {record.why}")
    return msgspec.convert(record.report, FlightReport)


@contextlib.contextmanager
def _interrupts(client: Client, progress: Progress) -> Iterator[None]:
    """Signals become the service's orders; the mission is not left alone by a closed terminal."""
    delivered = 0

    def stop(*_: object) -> None:
        nonlocal delivered
        name = "stop" if delivered == 0 else "land"
        progress.note(f"asking the service to {name}")
        try:
            client.command(name)
        except AutonomyError as error:
            # Raised out of a signal handler it would end this program, and the order with it.
            progress.note(f"{name} was not delivered ({error}); press Ctrl-C to try again")
        else:
            delivered += 1

    before = {number: signal.signal(number, stop) for number in termination_signals()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
