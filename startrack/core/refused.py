"""A value that breaks a rule -> the error that says so, which is no fault of the program."""

from __future__ import annotations

from typing import Any


class Refused(ValueError):
    """A value that a rule forbids: of a parameter, between parameters, or of what a step can do.

    The only error that a search takes for a design that is not feasible, and that a ledger keeps.
    Any other exception, another ValueError too, is a fault, and ends what was asked for.

    key      the parameter, as the message names it; "" where the message is a sentence of its own
    rule     what it must be; "" likewise
    value    what it is instead
    lasting  whether it holds as long as the design: no ledger keeps what the machine refuses
    """

    def __init__(
        self,
        message: str,
        *,
        key: str = "",
        rule: str = "",
        value: Any = None,
        lasting: bool = True,
    ):
        super().__init__(message)
        self.key, self.rule, self.value, self.lasting = key, rule, value, lasting

    def within(self, place: str, message: str = "") -> Refused:
        """This refusal of a part, as that of what holds it: "place: message"."""
        key = f"{place}.{self.key}" if self.key else place
        return Refused(
            f"{place}: {message or self}",
            key=key, rule=self.rule, value=self.value, lasting=self.lasting,
        )  # fmt: skip


class WrongType(Refused, TypeError):
    """A value of a kind that the parameter cannot have."""
