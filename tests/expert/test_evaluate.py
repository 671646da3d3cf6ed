"""``python -m lerobot_spacedock.expert.evaluate``: its options."""

from lerobot_spacedock.expert.evaluate import main


def test_a_checkpoint_that_no_policy_would_fly_is_refused(capsys):
    options = ["--tasks=fixed same", "--episodes=1", "--checkpoint=/nonexistent"]
    assert main(["--policies=W,mpc", *options]) == 2
    said = capsys.readouterr().err
    assert "--checkpoint: got /nonexistent; allowed: nothing, unless --policies names a meta_rl" in said
    assert main(["--policies=W,meta_rl", *options]) == 2
