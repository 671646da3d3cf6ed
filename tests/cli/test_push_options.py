"""``spacedock push``: a flag of another kind is refused before anything is read."""

import pytest

from lerobot_spacedock.dataset.push import PushConfig, push
from lerobot_spacedock.errors import InputError


@pytest.mark.parametrize("kind", ["dataset", "env"])
def test_the_logs_of_an_evaluation_go_on_the_card_of_a_policy_alone(tmp_path, kind):
    with pytest.raises(InputError, match=r"--log_dir: got .*nothing, unless --kind=policy"):
        push(PushConfig("a/b", kind=kind, log_dir=str(tmp_path), root=str(tmp_path / "none"), dry_run=True))
