"""Whether a policy can act where it is asked to."""

from pathlib import Path

from archerfish.controllers.guarded_policy import controller_from_record
from archerfish.records.errors import InputError
from archerfish.records.policy import PolicyRecord


def check_policy(path: Path, policy: PolicyRecord, period_s: float, command_limit: str) -> None:
    """Refuse a policy that was trained for another period or command limit, or can't be built.

    Args:
      path: of its record, for the message.
      policy: the record.
      period_s: between two decisions [s].
      command_limit: "box", "gate" or "los-2deg".

    Raises:
      InputError: saying what to do.
    """
    if abs(policy.period_s - period_s) > 1e-9:
        raise InputError(
            f"{path}: trained for decisions every {policy.period_s} s, the setting has {period_s} s; train it anew"
        )
    if policy.command_limit != command_limit:
        raise InputError(
            f"{path}: trained under the command limit {policy.command_limit}, not {command_limit}; "
            f"pass --command-limit {policy.command_limit} or train it anew"
        )
    try:
        controller_from_record(policy)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
