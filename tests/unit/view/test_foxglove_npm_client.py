"""Foxglove live with Foxglove's own client, `@foxglove/ws-protocol` of npm, under both sub-protocols."""

import asyncio
import json
import shutil
import subprocess
from pathlib import Path

import pytest
from test_foxglove_server import SDK, V1, played, run, serving

from rmr.record.recording import open_recording

__all__ = ["run"]

pytestmark = pytest.mark.slow

CACHE = Path(__file__).parents[3] / "build" / "npm"
PACKAGES = ("@foxglove/ws-protocol@0.8.0", "ws@8.18.0")
SCRIPT = """
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const { WebSocket } = require("ws");
const [address, protocol] = process.argv.slice(-2);
const found = { protocol: null, name: null, channels: [], poses: 0, first: null, scene: 0, times: 0, status: [] };
const client = new FoxgloveClient({ ws: new WebSocket(address, [protocol]) });
const topics = new Map();
client.on("error", (error) => { console.error(error); process.exit(1); });
client.on("serverInfo", (info) => { found.name = info.name; });
client.on("advertise", (channels) => {
  for (const channel of channels) {
    JSON.parse(channel.schema);
    found.channels.push(channel.topic);
    if (channel.topic === "/tf" || channel.topic === "/scene") topics.set(client.subscribe(channel.id), channel.topic);
  }
});
client.on("time", () => { found.times += 1; });
client.on("message", ({ subscriptionId, timestamp, data }) => {
  const message = JSON.parse(new TextDecoder().decode(data));
  if (topics.get(subscriptionId) === "/scene") { found.scene += message.entities.length; return; }
  found.first ??= { at: Number(timestamp), frame: message.transforms[0].child_frame_id };
  found.poses += 1;
});
client.on("status", ({ message }) => {
  found.status.push(message);
  setTimeout(() => { console.log(JSON.stringify(found)); process.exit(0); }, 500);
});
"""


@pytest.fixture(scope="module")
def packages():
    """The folder of the npm packages, installed once into build/."""
    npm = shutil.which("npm")
    if npm is None or shutil.which("node") is None:
        pytest.skip("npm or node is not installed")
    if not (CACHE / "node_modules" / "@foxglove" / "ws-protocol").is_dir():
        CACHE.mkdir(parents=True, exist_ok=True)
        command = [npm, "install", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", str(CACHE), *PACKAGES]
        done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
        if done.returncode:
            pytest.skip(f"npm cannot install {PACKAGES}: {done.stderr.strip()[-200:]}")
    return CACHE


@pytest.mark.parametrize("protocol", [V1, SDK])
def test_npm_client_reads_channels_poses_scene_and_time(run, packages, protocol):
    script = packages / "client.cjs"
    script.write_text(SCRIPT)

    async def check():
        async with serving(played(run, 20.0)) as (address, _):
            process = await asyncio.create_subprocess_exec(
                "node", str(script), address, protocol, stdout=subprocess.PIPE, stderr=subprocess.PIPE
            )
            out, err = await asyncio.wait_for(process.communicate(), 60)
            assert process.returncode == 0, err.decode()
            return json.loads(out)

    found = asyncio.run(check())
    assert found["name"] == "rmr: corridor, simulated, seed 7"
    assert {"/tf", "/scene", "/trace", "/frames"} <= set(found["channels"])
    assert found["poses"] == len(list(open_recording(run).messages(["/tf"])))
    assert found["first"] == {"at": 0, "frame": "robot/1"}
    assert found["scene"] >= 7
    assert found["times"] > 3
