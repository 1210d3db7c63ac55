"""Stands in for the worker: the mock over TCP, started and stopped in the same way."""

import json
import os
import sys
import threading
import time

import uvicorn

from llm.mock.app import create_app

way = sys.argv[1]

if way == "missing":
    sys.stdout.write(json.dumps({"error": "the embedded model is not installed"}) + "\n")
    sys.exit(3)
if way == "mute":
    sys.exit(1)
if way == "dying":
    sys.stdout.write(json.dumps({"base_url": "http://127.0.0.1:9/v1"}) + "\n")
    sys.exit(1)
if way == "lingering":
    sys.stdout.write(json.dumps({"base_url": "http://127.0.0.1:9/v1"}) + "\n")
    sys.stdout.flush()
    time.sleep(2.0)
    sys.exit(1)
if way == "slow":
    time.sleep(3600.0)

server = uvicorn.Server(
    uvicorn.Config(create_app(), host="127.0.0.1", port=0, log_level="critical")
)
thread = threading.Thread(target=server.run, daemon=True)
thread.start()
while not server.started:
    time.sleep(0.01)
port = server.servers[0].sockets[0].getsockname()[1]
sys.stdout.write("something else first\n")
sys.stdout.write(json.dumps({"base_url": f"http://127.0.0.1:{port}/v1", "pid": os.getpid()}) + "\n")
sys.stdout.flush()
if way == "deaf":
    time.sleep(60.0)
sys.stdin.read()
