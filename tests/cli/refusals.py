"""How a command refuses what a user got wrong."""


def refused(command, name, *arguments, words):
    """Run it and check the refusal, and that it leaves nothing behind."""
    before = sorted(command.cwd.rglob("*"))
    found = check_refusal(command, name, *arguments, words=words)
    assert sorted(command.cwd.rglob("*")) == before
    return found


def check_refusal(command, name, *arguments, words):
    """Run it and check the refusal; ``words`` must all be in the one line."""
    done = command(name, *arguments)
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stdout == ""
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1, done.stderr
    for word in words:
        assert word in done.stderr
    return done.stderr
