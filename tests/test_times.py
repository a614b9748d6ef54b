"""Times as dates, durations or numbers, and samples with a mask."""

from datetime import datetime, timedelta, timezone

import numpy as np
import pytest

import romsindy as rs

_STEP, _N = 0.0125, 400
_SAMPLES = np.cos(20 * _STEP * np.arange(_N))
_NANOSECONDS = np.arange(_N) * 12_500_000
_CLOCKS = {
    "dates": np.datetime64("2024-02-28T23:59:58.123456789") + _NANOSECONDS.astype("m8[ns]"),
    "durations": (_NANOSECONDS // 1000).astype("m8[us]"),
    "datetime": [datetime(2024, 12, 31, 23, 59) + timedelta(seconds=_STEP * i) for i in range(_N)],
    "timedelta": [timedelta(seconds=_STEP * i) for i in range(_N)],
    "zones": [
        datetime(2024, 3, 31, tzinfo=timezone.utc) + timedelta(seconds=_STEP * i) for i in range(_N)
    ],
}


def records(t, x):
    """Every public way to make a record of arrays."""
    return {
        "Decay": rs.Decay(t, x),
        "velocity": rs.Decay.from_velocity(t, x),
        "forced": rs.ForcedVibration(t, x, x),
        "recording": rs.Recording(t, x),
        "SEP005": rs.load_recording({"data": x, "time": t, "name": "q", "unit_str": "m"}),
    }


@pytest.mark.parametrize("clock", _CLOCKS)
def test_dates_and_durations_are_seconds(clock):
    """Exact: 12.5 ms are 12.5 ms, whatever counts them."""
    for name, record in records(_CLOCKS[clock], _SAMPLES).items():
        first = round(record.t[0] / _STEP)  # an integration cuts the start
        expected = _STEP * (first + np.arange(len(record.t)))
        np.testing.assert_allclose(record.t, expected, rtol=1e-12, atol=1e-12, err_msg=name)
        assert record.dt == pytest.approx(_STEP, rel=1e-12)


def test_times_of_pandas_are_seconds():
    pandas = pytest.importorskip("pandas")
    seconds = _STEP * np.arange(_N)
    for t in (
        pandas.to_datetime(seconds, unit="s"),
        pandas.Series(pandas.to_datetime(seconds, unit="s")),
        pandas.to_datetime(seconds, unit="s").tz_localize("Europe/Berlin"),
        pandas.to_timedelta(seconds, unit="s"),
    ):
        np.testing.assert_allclose(rs.Decay(t, _SAMPLES).t, seconds, atol=1e-9)


def test_months_and_dates_as_samples_are_refused():
    with pytest.raises(ValueError, match="t must be times in s, dates or durations"):
        rs.Decay(np.arange(_N).astype("M8[M]"), _SAMPLES)
    with pytest.raises(ValueError, match="q must be an array of real numbers"):
        rs.Decay(_STEP * np.arange(_N), _CLOCKS["durations"])
    with pytest.raises(ValueError, match="u must be an array of real numbers"):
        rs.ForcedVibration(_STEP * np.arange(_N), _SAMPLES, _CLOCKS["dates"])


def test_masked_samples_are_missing():
    """Where a record may have gaps they are gaps, else they are refused with what to do."""
    t, masked = _STEP * np.arange(_N), np.ma.array(_SAMPLES, mask=np.arange(_N) == 7)
    for make in (
        lambda: rs.Decay(t, masked),
        lambda: rs.Decay(t, _SAMPLES, masked, masked),
        lambda: rs.Decay.from_velocity(t, masked),
        lambda: rs.Decay.from_acceleration(t, masked),
        lambda: rs.ForcedVibration(t, masked, _SAMPLES),
        lambda: rs.ForcedVibration(t, _SAMPLES, masked),
    ):
        with pytest.raises(ValueError, match=r"1 value that is NaN, infinite or masked.*7: cut"):
            make()
    for record in (
        rs.Recording(t, masked),
        rs.load_recording({"data": masked, "time": t, "name": "q", "unit_str": "m"}),
    ):
        assert np.flatnonzero(np.isnan(record.x)).tolist() == [7]
    with pytest.raises(ValueError, match="t has 1 value that is NaN, infinite or masked"):
        rs.Decay(np.ma.array(t, mask=np.arange(_N) == 7), _SAMPLES)
    unmasked = rs.Decay(np.ma.array(t), np.ma.array(_SAMPLES))
    np.testing.assert_array_equal(unmasked.q, _SAMPLES)
