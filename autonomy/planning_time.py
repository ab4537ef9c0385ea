"""Algorithm 1 beside a running flight: how long each replan took, as the shell measured it."""

from autonomy.model import Decision, Plan
from autonomy.t3drm.timing import ComputationTime, TimingRecord


class PlanningTime:
    """Fed with every decision and the seconds its step took; starts with the first."""

    def __init__(self) -> None:
        self._record: ComputationTime | None = None

    def note(self, decision: Decision, step_s: float) -> None:
        """One tick; only those that planned are remembered."""
        if self._record is None:
            self._record = ComputationTime(decision.now_s)
        plan = decision.plan
        if plan is not None:
            keep_out_m = plan.keep_out_m if isinstance(plan, Plan) else 0.0
            self._record.replanned(decision.now_s, step_s, len(plan.obstacles), keep_out_m)
        if decision.outcome is not None:
            self._record.completed(decision.now_s)

    def record(self) -> TimingRecord | None:
        """What is known now; None before the first tick."""
        return None if self._record is None else self._record.record()
