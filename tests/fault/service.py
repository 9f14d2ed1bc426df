"""A `lightkiln serve` of its own for the campaigns of this folder, and HTTP for people who misbehave.
Python's standard library only."""

import atexit
import http.client
import json
import os
import pathlib
import re
import signal
import socket
import subprocess
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]


def default_binary():
    return str(ROOT / "build" / "release" / "lightkiln")


class Answer:
    def __init__(self, status, headers, body):
        self.status, self.headers, self.body = status, headers, body

    @property
    def json(self):
        return json.loads(self.body)

    @property
    def code(self):
        try:
            return self.json.get("code", "")
        except (ValueError, AttributeError):
            return ""


class Service:
    """The program in a process of its own. `data` stays when it is killed."""

    def __init__(self, binary, data, flags=(), wrapper=()):
        self.binary, self.data, self.flags, self.wrapper = binary, str(data), list(flags), list(wrapper)
        self.process = None
        self.log = []
        self.start()

    def start(self):
        command = self.wrapper + [self.binary, "serve", "--port", "0", "--admin-port", "0", "--data",
                                  self.data, "--log-format", "json"] + self.flags
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL,
                                        stdout=subprocess.DEVNULL)
        atexit.register(self.process.kill)  # whatever becomes of the campaign
        self.ready = threading.Event()
        self.port = self.admin_port = None
        threading.Thread(target=self._read_log, args=(self.process.stderr,), daemon=True).start()
        if not self.ready.wait(60) or self.port is None:
            raise SystemExit("the service did not start:\n" + "\n".join(self.log[-5:]))

    def _read_log(self, pipe):
        for raw in pipe:
            line = raw.decode(errors="replace").rstrip()
            if self.port is None and '"event":"ready"' in line:
                said = json.loads(line)
                self.port = int(said["api"].rsplit(":", 1)[1])
                self.admin_port = int(said["admin"].rsplit(":", 1)[1])
                self.ready.set()
            if '"level":"info"' not in line:
                self.log.append(line)
                del self.log[:-1000]
        self.ready.set()  # or it will never be

    @property
    def pid(self):
        return self.process.pid

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def stop(self):
        """Drains; the exit code."""
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(120)

    def alive(self):
        return self.process.poll() is None

    def rss(self):
        """Resident memory in bytes that is the process's own: without mapped files."""
        return status_kib(self.pid, "RssAnon") * 1024

    def descriptors(self):
        return len(os.listdir(f"/proc/{self.pid}/fd"))

    def ask(self, method, path, body=None, headers=None, port=None, timeout=60):
        return ask(port or self.port, method, path, body, headers, timeout)

    def metric(self, name):
        text = self.ask("GET", "/metrics", port=self.admin_port).body.decode()
        found = re.search(rf"^{re.escape(name)} (\S+)$", text, re.M)
        return float(found.group(1)) if found else None

    def post_job(self, scene, settings=None, options=None, headers=None):
        return self.ask("POST", "/v1/jobs", *form(scene, settings, options, headers))

    def wait(self, job, seconds=120, headers=None):
        """The job once it is over, or as it is when the time is."""
        end = time.monotonic() + seconds
        while True:
            document = self.ask("GET", f"/v1/jobs/{job}?wait=5", headers=headers).json
            if document.get("state") in ("succeeded", "failed", "canceled") or time.monotonic() > end:
                return document


def ask(port, method, path, body=None, headers=None, timeout=60):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=timeout)
    try:
        connection.request(method, path, body, headers or {})
        response = connection.getresponse()
        return Answer(response.status, response.headers, response.read())
    finally:
        connection.close()


def form(scene, settings=None, options=None, headers=None):
    """Body and headers of a multipart job; scene is bytes."""
    parts = [('name="scene"; filename="scene.glb"', scene)]
    if settings is not None:
        parts.append(('name="settings"', json.dumps(settings).encode()))
    if options is not None:
        parts.append(('name="options"', json.dumps(options).encode()))
    body = b"".join(b"--B\r\nContent-Disposition: form-data; " + head.encode() + b"\r\n\r\n" + content +
                    b"\r\n" for head, content in parts) + b"--B--\r\n"
    return body, {"Content-Type": "multipart/form-data; boundary=B", **(headers or {})}


class Wire:
    """A TCP connection that says exactly the bytes it is told."""

    def __init__(self, port, timeout=5, address="127.0.0.1"):
        self.socket = socket.create_connection((address, port), timeout)

    def send(self, data):
        """False when the peer has closed."""
        try:
            self.socket.sendall(data if isinstance(data, bytes) else data.encode("latin-1"))
            return True
        except OSError:
            return False

    def read(self, until=b"", limit=1 << 20):
        """What comes up to `until`, the end, or the time-out."""
        text = b""
        try:
            while len(text) < limit and (not until or until not in text):
                piece = self.socket.recv(65536)
                if not piece:
                    break
                text += piece
        except OSError:
            pass
        return text

    def status(self):
        """Of the answer; 0 when there is none."""
        text = self.read(b"\r\n\r\n")
        return int(text[9:12]) if text.startswith(b"HTTP/1.1 ") else 0

    def vanish(self):
        """Resets the connection instead of closing it."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        self.socket.close()

    def close(self):
        self.socket.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


class Prober(threading.Thread):
    """Asks for /healthz all the time from a process of its own and keeps how long each answer took."""

    SCRIPT = """
import http.client, sys, time
port, every = int(sys.argv[1]), float(sys.argv[2])
while True:
    began = time.monotonic()
    try:
        c = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
        c.request("GET", "/healthz")
        ok = c.getresponse().status == 200
        c.close()
    except OSError:
        ok = False
    took = time.monotonic() - began
    print(took if ok else -1, flush=True)
    time.sleep(max(0, every - took))
"""

    def __init__(self, port, every=0.05):
        super().__init__(daemon=True)
        self.times, self.failures = [], 0
        self.process = subprocess.Popen(["python3", "-c", self.SCRIPT, str(port), str(every)],
                                        stdout=subprocess.PIPE, text=True)
        self.start()

    def run(self):
        for line in self.process.stdout:
            value = float(line)
            if value < 0:
                self.failures += 1
            else:
                self.times.append(value)

    def finish(self):
        self.process.kill()
        self.process.wait()
        self.join()
        return summary_ms(self.times)


def status_kib(pid, name):
    for line in open(f"/proc/{pid}/status"):
        if line.startswith(name + ":"):
            return int(line.split()[1])
    return 0


def quantile(values, share):
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else 0.0


def summary_ms(times):
    return {"count": len(times), "p50_ms": round(quantile(times, 0.5) * 1000, 3),
            "p99_ms": round(quantile(times, 0.99) * 1000, 3),
            "max_ms": round(max(times, default=0) * 1000, 3)}


def scene_bytes(binary, name):
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "scene.glb"
        subprocess.run([binary, "scene", name, "-o", str(path)], check=True, stdout=subprocess.DEVNULL,
                       stderr=subprocess.DEVNULL)
        return path.read_bytes()


def events(service, job, after=0, timeout=60, headers=None):
    """The events of a stream up to its end or a pause of `timeout`: (id, type, data)."""
    with Wire(service.port, timeout) as wire:
        extra = "".join(f"{k}: {v}\r\n" for k, v in (headers or {}).items())
        wire.send(f"GET /v1/jobs/{job}/events?after={after} HTTP/1.1\r\nHost: x\r\n{extra}\r\n")
        text = wire.read(b"\r\n0\r\n\r\n", 1 << 26).decode(errors="replace")
    found = re.findall(r"^id: (\d+)\nevent: (\S+)\ndata: (.*)$", text.replace("\r\n", "\n"), re.M)
    return [(int(number), kind, data) for number, kind, data in found]


def machine():
    """What the figures depend on."""
    model = next((line.split(":", 1)[1].strip() for line in open("/proc/cpuinfo")
                  if line.startswith("model name")), "unknown processor")
    return {"processors": os.cpu_count(), "model": model, "load": round(os.getloadavg()[0], 2),
            "time": time.strftime("%Y-%m-%d %H:%M")}


def large_scene(scene, size):
    """A .glb with `size` bytes of buffer, most of which nothing uses."""
    json_size = int.from_bytes(scene[12:16], "little")
    document = json.loads(scene[20:20 + json_size])
    content = scene[28 + json_size:]
    size -= size % 4
    document["buffers"][0]["byteLength"] = size
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    content = content[:size] + bytes(size - len(content))
    word = lambda value: value.to_bytes(4, "little")
    return (b"glTF" + word(2) + word(28 + len(text) + size) + word(len(text)) + b"JSON" + text +
            word(size) + b"BIN\0" + content)
