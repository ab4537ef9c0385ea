"""The signals that ask this program to end tidily."""

import signal


def termination_signals() -> tuple[signal.Signals, ...]:
    """Ctrl-C, `kill`, and the terminal that goes away (a dropped ssh session) unless the person
    who started this program had it ignored, as nohup does.
    """
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        return (signal.SIGINT, signal.SIGTERM)
    return (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
