"""The ClientApp of a node."""

from collections.abc import Callable
from pathlib import Path

from flwr.app import Context, Message, RecordDict
from flwr.clientapp import ClientApp

from zk0_flower.member import BadSettings, Member
from zk0_flower.messages import Request
from zk0_flower.program import Program

SETTINGS = "zk0-node"
"""The key of the SuperNode's configuration that names the settings file of the node."""

PROGRAM = "zk0-program"
"""The key of the SuperNode's configuration that names the program ``zk0``, if another one than the installed is meant."""


def member_of(context: Context) -> Member:
    """The node that the SuperNode's configuration names. Raises `BadSettings` if it names none."""
    settings = context.node_config.get(SETTINGS)
    if not isinstance(settings, str):
        raise BadSettings(
            f"this SuperNode does not say which zk0 node it is: start it with --node-config '{SETTINGS}=\"/path/to/node.toml\"'"
        )
    program = Program(str(context.node_config.get(PROGRAM, Program.path)))
    return Member.of_settings(Path(settings), program)


def client_app(member: Callable[[Context], Member] = member_of) -> ClientApp:
    """A ClientApp that commits and proves for the node that ``member`` returns. You can add functions of your own to it, such as
    ``@app.evaluate()``.
    """
    app = ClientApp()

    @app.train("commit")
    def commit(message: Message, context: Context) -> Message:
        return member(context).commit(Request.read(message)).message(message)

    @app.train("prove")
    def prove(message: Message, context: Context) -> Message:
        member(context).prove(Request.read(message))
        return Message(content=RecordDict(), reply_to=message)

    return app
