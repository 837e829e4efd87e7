"""Files dated in the future get the present time, in their order; all others are left alone."""

import os
import time

from coronaryuq.core.io.mtime import reset_future_times


def test_files_from_the_future_get_the_present_time_in_their_order(tmp_path):
    now = time.time()
    offsets = {"old": -1e6, "now": -5.0, "skewed": 1.0, "second": 4e7, "part/first": 3e7, "part/third": 4e7 + 0.01}
    for name, offset in offsets.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
        os.utime(tmp_path / name, (now + offset, now + offset))
    moved = reset_future_times(tmp_path)
    assert [path.relative_to(tmp_path).as_posix() for path in moved] == ["part/first", "second", "part/third"]
    times = [(tmp_path / name).stat().st_mtime for name in ("old", "now", "part/first", "second", "part/third")]
    assert times == sorted(times) and len(set(times)) == 5 and times[-1] <= time.time()
    assert (tmp_path / "skewed").stat().st_mtime == now + 1.0
    assert reset_future_times(tmp_path) == []
