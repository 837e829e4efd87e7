"""The lock of a results folder, and file systems without locks."""

import errno
import fcntl

import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.lock import lock_results


def test_two_campaigns_do_not_share_a_folder(tmp_path):
    with lock_results(tmp_path), pytest.raises(InputError, match="another campaign is running here"):
        lock_results(tmp_path)


@pytest.mark.parametrize("reason", [errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL, errno.EIO])
def test_a_file_system_without_locks_gives_a_note_and_goes_on(tmp_path, monkeypatch, capsys, reason):
    def flock(*_):
        raise OSError(reason, "no locks")

    monkeypatch.setattr(fcntl, "flock", flock)
    with lock_results(tmp_path):
        pass
    assert "this file system has no locks" in capsys.readouterr().err
