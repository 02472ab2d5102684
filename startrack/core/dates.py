"""Date as text -> astropy Time, converted with the installed tables.

Earth orientation, leap seconds and ephemerides are those installed with astropy and its package
astropy-iers-data, also at dates beyond their end. Nothing is downloaded, and no result depends on
the day on which it is computed.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from startrack.core.checks import Refused


@contextmanager
def installed_tables() -> Iterator[None]:
    """Context in which astropy converts times and axes with its installed tables, however old.

    Every use of astropy's Time and coordinates belongs in it: the first conversion of a time in a
    process looks for newer leap seconds, and each conversion to the Earth's axes for a newer Earth
    orientation. It may be nested.

    Accuracy    model: beyond the installed Earth orientation, which ends about a year after its
                release, UT1 - UTC keeps its last value u, and before its beginning in 1973 its
                first. While leap seconds are kept, |UT1 - UTC| < 0.9 s, and the angle of the
                Earth's rotation errs by less than 0.9 s + |u|; a second is 465 m of ground at the
                equator. So the error is below 0.84 km, and below 0.52 km for u = -0.21 s, with
                which the table of November 2026 ends. Measured with tables cut off in 2000 to
                2024, at observed dates until 2026: 1.17 s (0.54 km) at most, five leap seconds
                after a table that ended in 2005; 0.08 s (35 m) 19 months after one that ended in
                2024. Without leap seconds the bound would not hold: UT1 has drifted from atomic
                time by 0 to 1 s a year since 1973.
                The pole is then its mean of 1962 to 2014: 0.31 arcsec (10 m) off at most since
                1973.
                Leap seconds decided after the release are unknown. Each puts the time of
                ephemerides 1 s off: the Earth is 30 km away, the direction of the Sun is 0.04
                arcsec off, that of a planet less than 0.1 arcsec, that of the Moon 0.55 arcsec;
                aberration changes by 4e-6 arcsec, parallax by 2e-7 of itself. An orbit over ground
                does not change.
    """
    from astropy.utils import iers  # costs 0.3 s, and only dates need it

    with (
        iers.conf.set_temp("auto_download", False),
        iers.conf.set_temp("auto_max_age", None),
        iers.conf.set_temp("iers_degraded_accuracy", "ignore"),
        warnings.catch_warnings(),
    ):
        warnings.filterwarnings("ignore", message=".*dubious year.*")  # leap seconds to come
        warnings.filterwarnings("ignore", message=".*(polar motions|IERS).*")
        warnings.filterwarnings("ignore", category=iers.IERSStaleWarning)
        yield


def utc(text: str) -> Any:
    """A time from ISO 8601, UTC.

    Raises  ValueError where the text is no time.
    """
    from astropy.time import Time

    try:
        with installed_tables():
            return Time(text.removesuffix("Z"), scale="utc")
    except ValueError:
        raise Refused(f"epoch must be a time such as 2026-06-21T10:00:00, got {text!r}") from None
