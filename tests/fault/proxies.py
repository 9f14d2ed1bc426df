#!/usr/bin/env python3
"""Debian's nginx or Caddy on loopback, with docs/nginx.conf or docs/Caddyfile, in front of the
service: event streams come through as they are sent, a large upload passes, TLS ends at the proxy.
Exit code 77: there is no such proxy here.
Usage: proxies.py nginx|caddy PROGRAM WORK     WORK is a folder that the proxy may be unpacked in."""

import http.client
import os
import pathlib
import shutil
import socket
import ssl
import subprocess
import sys
import tempfile
import time

import service as lk

UPLOAD = 220 << 20
PATIENCE = 120  # seconds; beyond, nothing comes


def find_proxy(work, name, place, probe):
    """The installed one, else the package's program unpacked into `work`: nothing gets installed."""
    found = shutil.which(name, path=os.environ["PATH"] + ":/usr/sbin:/usr/local/sbin")
    unpacked = work / place
    if found or unpacked.exists():
        return found or str(unpacked)
    work.mkdir(parents=True, exist_ok=True)
    if subprocess.run(["apt-get", "download", name], cwd=work, stdout=subprocess.DEVNULL,
                      stderr=subprocess.DEVNULL).returncode == 0:
        for package in work.glob(name + "_*.deb"):
            subprocess.run(["dpkg", "-x", str(package), str(work)], check=True)
    if unpacked.exists() and subprocess.run([str(unpacked), probe], stdout=subprocess.DEVNULL,
                                            stderr=subprocess.DEVNULL).returncode == 0:
        return str(unpacked)
    return None


def make_certificate(folder):
    subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "1",
                    "-subj", "/CN=bake.example.org", "-keyout", folder / "key.pem", "-out",
                    folder / "cert.pem"], check=True, stderr=subprocess.DEVNULL)


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Proxy:
    """A process that speaks TLS on `port`."""

    def start(self, command, **options):
        self.process = subprocess.Popen(command, **options)
        self.context = ssl._create_unverified_context()
        for _ in range(100):
            try:
                self.connection().close()
                return
            except OSError:
                assert self.process.poll() is None, self.log.read_text()
                time.sleep(0.1)

    def connection(self):
        made = http.client.HTTPSConnection("127.0.0.1", self.port, timeout=60, context=self.context)
        made.connect()
        return made

    def ask(self, method, path, body=None, headers=None):
        connection = self.connection()
        connection.request(method, path, body, headers or {})
        response = connection.getresponse()
        answer = lk.Answer(response.status, response.headers, response.read())
        connection.close()
        return answer

    def stop(self):
        self.process.terminate()
        self.process.wait()


class Nginx(Proxy):
    """docs/nginx.conf with the ports and the certificate of this test."""

    def __init__(self, program, folder, upstream):
        self.port = free_port()
        make_certificate(folder)
        text = (lk.ROOT / "docs/nginx.conf").read_text()
        for old, new in (("127.0.0.1:8080", f"127.0.0.1:{upstream}"),
                         ("listen 443 ssl", f"listen 127.0.0.1:{self.port} ssl"),
                         ("/etc/ssl/certs/bake.example.org.pem", str(folder / "cert.pem")),
                         ("/etc/ssl/private/bake.example.org.key", str(folder / "key.pem"))):
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        temporary = "".join(f"{kind}_temp_path {folder}/{kind};\n" for kind in
                            ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
        user = "user root;\n" if os.geteuid() == 0 else ""
        (folder / "nginx.conf").write_text(
            f"{user}daemon off;\npid {folder}/pid;\nerror_log {folder}/error.log;\n"
            f"events {{ worker_connections 512; }}\nhttp {{\naccess_log off;\n{temporary}{text}}}\n")
        self.log = folder / "error.log"
        self.start([program, "-p", str(folder), "-c", str(folder / "nginx.conf")],
                   stderr=subprocess.DEVNULL)


class Caddy(Proxy):
    """docs/Caddyfile, likewise. It gets no certificate by itself: nobody out there would give it one."""

    def __init__(self, program, folder, upstream):
        self.port = free_port()
        make_certificate(folder)
        text = (lk.ROOT / "docs/Caddyfile").read_text()
        for old, new in (("127.0.0.1:8080", f"127.0.0.1:{upstream}"),
                         ("bake.example.org {\n",
                          f"https://:{self.port} {{\n\ttls {folder}/cert.pem {folder}/key.pem\n")):
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        (folder / "Caddyfile").write_text(
            "{\n\tadmin off\n\tauto_https disable_redirects\n}\n" + text)
        self.log = folder / "caddy.log"
        home = {name: str(folder) for name in ("HOME", "XDG_DATA_HOME", "XDG_CONFIG_HOME")}
        with open(self.log, "wb") as log:
            self.start([program, "run", "--adapter", "caddyfile", "--config", str(folder / "Caddyfile")],
                       stderr=log, stdout=log, env={**os.environ, **home})


def check_stream(service, proxy, scene):
    """Heartbeats come while the stream goes on: a proxy that buffers would hold back hundreds of them.

    Their pace is told, not asserted: it is the machine's as well.
    """
    # The first of them takes a minute of two processors, and is deleted before.
    settings = {"atlas": {"page_size": 1024}, "solver": {"samples": 4096, "direct_samples": 4096}}
    ids = [service.post_job(scene, settings, {"dedupe": False}).json["id"] for _ in range(2)]
    waiting = ids[1]  # one runs at a time
    connection = proxy.connection()
    connection.request("GET", f"/v1/jobs/{waiting}/events")
    response = connection.getresponse()
    assert response.status == 200, response.status
    began, beats = time.monotonic(), []
    while len(beats) < 4 and time.monotonic() - began < PATIENCE:
        if response.readline().startswith(b": hb"):
            beats.append(time.monotonic() - began)
    gaps = [round(b - a, 2) for a, b in zip(beats, beats[1:])]
    assert len(gaps) == 3, beats
    now = service.ask("GET", f"/v1/jobs/{waiting}").json["state"]
    assert now == "queued", f"they were held back until the job was {now}: {beats}"
    # An event on the same connection comes before the stream is long enough to fill a buffer.
    canceled = time.monotonic()
    assert service.ask("POST", f"/v1/jobs/{waiting}/cancel").status in (200, 202)
    while b"event: job.end" not in response.readline():
        assert time.monotonic() - canceled < PATIENCE
    took = time.monotonic() - canceled
    connection.close()
    service.ask("DELETE", f"/v1/jobs/{ids[0]}?force=true")
    return f"heartbeats {gaps} s apart, an event after {took * 1000:.0f} ms"


def check_upload(proxy, scene):
    body = lk.large_scene(scene, UPLOAD)
    began = time.monotonic()
    answer = proxy.ask("POST", "/v1/scenes", body, {"Content-Type": "model/gltf-binary"})
    seconds = time.monotonic() - began
    assert answer.status == 201, (answer.status, answer.body[:300])
    assert answer.json["bytes"] == len(body)
    pieces = (body[at:at + (1 << 20)] for at in range(0, len(body), 1 << 20))
    again = proxy.ask("POST", "/v1/scenes", pieces, {"Content-Type": "model/gltf-binary"})
    assert again.status == 200 and again.json["id"] == answer.json["id"], again.body[:300]
    return f"{len(body) >> 20} MiB in {seconds:.1f} s, and once more in chunks"


def check_job(service, proxy, scene):
    settings = {"atlas": {"page_size": 64}, "solver": {"samples": 8, "direct_samples": 4}}
    answer = proxy.ask("POST", "/v1/jobs", *lk.form(scene, settings))
    assert answer.status == 202, answer.body
    path = answer.headers["Location"]
    assert proxy.ask("GET", path + "?wait=60").json["state"] == "succeeded"
    whole = proxy.ask("GET", path + "/results/page_00.exr")
    part = proxy.ask("GET", path + "/results/page_00.exr", headers={"Range": "bytes=100-199"})
    assert part.status == 206 and part.body == whole.body[100:200]
    known = proxy.ask("GET", path + "/results/page_00.exr",
                      headers={"If-None-Match": whole.headers["ETag"]})
    assert known.status == 304
    assert whole.body == service.ask("GET", path + "/results/page_00.exr").body
    return f"posted, waited for, {len(whole.body)} bytes of result, a range of it, 304"


PROXIES = {"nginx": ("usr/sbin/nginx", "-v", Nginx), "caddy": ("usr/bin/caddy", "version", Caddy)}


def main():
    name, binary, work = sys.argv[1], sys.argv[2], pathlib.Path(sys.argv[3])
    place, probe, make = PROXIES[name]
    program = find_proxy(work, name, place, probe)
    if not program:
        print(f"skipped: {name} is not installed, and apt-get can't fetch its package")
        return 77
    with tempfile.TemporaryDirectory() as path:
        folder = pathlib.Path(path)
        service = lk.Service(binary, folder / "data",
                             ["--heartbeat-seconds", "1", "--max-running-jobs", "1"])
        proxy = make(program, folder, service.port)
        try:
            scene = lk.scene_bytes(binary, "cornell")
            print("job:   ", check_job(service, proxy, scene))
            print("stream:", check_stream(service, proxy, scene))
            print("upload:", check_upload(proxy, scene))
        finally:
            proxy.stop()
            service.kill()
    return 0


if __name__ == "__main__":
    sys.exit(main())
