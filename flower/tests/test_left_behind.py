"""A ClientApp may be killed while its node runs."""

import subprocess
import sys
import time
from pathlib import Path

from local_network import Network

from zk0_flower.left_behind import the_only_one

# A ClientApp, as far as the node is concerned: it waits for a commitment in a round that does not come.
CLIENT = """
import sys
from pathlib import Path
from zk0_flower import Member, Program
from zk0_flower.messages import Request

member = Member.of_settings(Path(sys.argv[1]), Program(sys.argv[2]))
member.commit(Request(member.network, sys.argv[3], 1000, 600.0))
"""


def test_a_node_whose_client_was_killed_ends_before_the_next_one_starts(network: Network, tmp_path: Path) -> None:
    state, file = tmp_path / "state", tmp_path / "node.toml"
    text = network.settings(network.nodes[0]).read_text()
    file.write_text(text.replace(str(network.out / "node" / "state"), str(state)))
    client = subprocess.Popen([sys.executable, "-c", CLIENT, str(file), network.zk0, network.log])
    lock = state / "flower.lock"
    while not (lock.exists() and lock.read_text()):
        assert client.poll() is None
        time.sleep(0.1)
    node = Path("/proc") / lock.read_text()
    client.kill()
    client.wait()
    # Nobody waits for the node, and it goes on.
    assert "node\0join" in (node / "cmdline").read_text()
    with the_only_one(lock) as taken:
        assert taken.read() == ""
        assert not node.exists() or "node\0join" not in (node / "cmdline").read_text()
