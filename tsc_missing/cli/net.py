"""``tsc-net``: import, generate, check and look at networks."""

from tsc_missing.cli.common import make_app, run_app
from tsc_missing.cli.net_check import check
from tsc_missing.cli.net_generate import generate
from tsc_missing.cli.net_import import import_network
from tsc_missing.cli.net_outages import outages
from tsc_missing.cli.net_show import show

HELP = "Make network folders that tsc-run can use, check them, and look at them."

app = make_app(HELP)


@app.callback(help=HELP)
def net() -> None:
    """Only gathers the commands."""


app.command("import")(import_network)
app.command("generate")(generate)
app.command("check")(check)
app.command("show")(show)
app.command("outages")(outages)


def main() -> None:
    """The entry point of ``tsc-net``."""
    run_app(app, "tsc-net")


if __name__ == "__main__":
    main()
