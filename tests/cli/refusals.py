"""How a command refuses what a user got wrong."""


def refused(command, name, *arguments, words):
    """Run it and check the refusal; ``words`` must all be in the one line."""
    before = sorted(command.cwd.rglob("*"))
    done = command(name, *arguments)
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stdout == ""
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1, done.stderr
    for word in words:
        assert word in done.stderr
    assert sorted(command.cwd.rglob("*")) == before
    return done.stderr
