"""Talk to `autonomy serve` from any computer, with Python's standard library alone.

Waits until the vehicle is ready, asks for a mission, and tells how it goes until it is over.
Ctrl-C asks the service to stop: it holds, then lands. A token, where one is needed, is taken from
AUTONOMY_TOKEN.
"""

import argparse
import json
import os
import time
import urllib.error
import urllib.request
from collections.abc import Sequence
from typing import Any


class Service:
    """The few requests that a mission needs; /v1/openapi.json describes all of them."""

    def __init__(self, url: str, token: str | None = None) -> None:
        self._url = url.rstrip("/")
        self._headers = {"Content-Type": "application/json"}
        if token:
            self._headers["Authorization"] = f"Bearer {token}"

    def ask(self, path: str, body: dict[str, Any] | None = None, method: str = "GET") -> Any:
        """The answer as JSON; raises SystemExit with a sentence when the service refuses, or when
        nobody answers.
        """
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(  # noqa: S310 - an address that the user typed
            f"{self._url}{path}", data, self._headers, method=method
        )
        try:
            with urllib.request.urlopen(request, timeout=10) as answer:  # noqa: S310 - as above
                return json.load(answer)
        except urllib.error.HTTPError as refused:
            raise SystemExit(json.load(refused)["error"]) from None
        except urllib.error.URLError as error:
            why = f"no service answers at {self._url} ({error.reason})"
            raise SystemExit(f"{why}; begin one with: autonomy serve --sim") from None


def fly(service: Service, north_m: float, east_m: float, poll_s: float = 0.5) -> dict[str, Any]:
    """One mission to its end; its record."""
    while (state := service.ask("/v1/state"))["phase"] != "ready":
        print(f"{state['phase']}: {state['why']}")
        time.sleep(poll_s)
    mission = service.ask("/v1/missions", {"goals": [[north_m, east_m]], "land": True}, "POST")
    try:
        while mission["status"] in ("queued", "flying"):
            time.sleep(poll_s)
            mission = service.ask(f"/v1/missions/{mission['id']}")
            flight = service.ask("/v1/state").get("flight")
            if flight is not None:
                print(f"{flight['state']}: {flight['distance_to_go_m']:.1f} m to go")
    except KeyboardInterrupt:
        service.ask("/v1/stop", {}, "POST")
        raise SystemExit("told it to stop: it holds, then lands") from None
    return dict(mission)


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code 0 when the goal was reached."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("url", nargs="?", default="http://127.0.0.1:8042")
    parser.add_argument("--goal", default="2,1", help="metres north,east", metavar="N,E")
    asked = parser.parse_args(arguments)
    north_m, east_m = (float(part) for part in asked.goal.split(","))
    mission = fly(Service(asked.url, os.environ.get("AUTONOMY_TOKEN")), north_m, east_m)
    print(f"{mission['status']}: {mission.get('ending')}, {mission['why']}")
    return int(mission.get("exit_code") or 0)


if __name__ == "__main__":
    raise SystemExit(main())
