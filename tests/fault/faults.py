#!/usr/bin/env python3
"""Faults of the machine under a running service: no memory, a store that can't be written, a clock that
jumps. Each says `skipped` where this machine can't make the fault.
Usage: faults.py PROGRAM WORK     WORK is a folder that libfaketime may be unpacked in."""

import http.client
import os
import pathlib
import resource
import shutil
import subprocess
import sys
import tempfile
import time

import service as lk

SMALL = {"atlas": {"page_size": 64}, "solver": {"samples": 8, "direct_samples": 4}}


def bakes(service, scene, seed, seconds=60):
    settings = {**SMALL, "solver": {**SMALL["solver"], "seed": seed}}
    answer = service.post_job(scene, settings)
    assert answer.status == 202, (answer.status, answer.body)
    return service.wait(answer.json["id"], seconds)


def no_memory(binary, folder, _):
    """A bake that gets no memory fails alone; the next one, and a small one beside it, do not."""
    service = lk.Service(binary, folder / "data", ["--threads", "2", "--memory-budget-bytes", "1024GiB"])
    scene = lk.scene_bytes(binary, "cornell")
    assert bakes(service, scene, 1)["state"] == "succeeded"
    # Of memory that can be written; an address space that is full stays so, by malloc's arenas.
    room = lk.status_kib(service.pid, "VmData") * 1024 + (256 << 20)
    resource.prlimit(service.pid, resource.RLIMIT_DATA, (room, room))
    large = {"atlas": {"page_size": 8192, "max_pages": 1}, "solver": {"samples": 1, "direct_samples": 1}}
    end = time.monotonic() + 100
    for seed in range(2, 8):
        large["solver"]["seed"] = seed
        job = service.post_job(scene, large).json["id"]
        for _ in range(600):
            try:  # a request may find no memory either, and is told so or cut off
                state = service.ask("GET", f"/v1/jobs/{job}").json.get("state", "")
            except (OSError, ValueError, http.client.HTTPException):
                state = ""
            assert time.monotonic() < end, f"no answer for long; the last state was '{state}'"
            assert service.alive(), "the service ended: " + "\n".join(service.log[-5:])
            if state in ("failed", "succeeded"):
                break
            time.sleep(0.05)
        failed = service.wait(job)
        assert failed["state"] == "failed" and failed["error"]["code"] == "out_of_memory", failed
    assert service.ask("GET", "/healthz", port=service.admin_port).status == 200
    assert bakes(service, scene, 2)["state"] == "succeeded"
    assert service.stop() == 0
    return "six times out_of_memory, and the next job succeeded"


def store_that_cannot_be_written(binary, folder, _):
    """SQLite's log becomes immutable while a job runs: reads go on, nothing new is promised, and all
    goes on when it can be written again."""
    service = lk.Service(binary, folder / "data")
    scene = lk.scene_bytes(binary, "cornell")
    assert bakes(service, scene, 1)["state"] == "succeeded"
    job = service.ask("GET", "/v1/jobs").json["items"][0]["id"]
    long = {"atlas": {"page_size": 64}, "solver": {"method": "path", "samples": 512}}
    running = service.post_job(scene, long).json["id"]
    wal = folder / "data/jobs.db-wal"
    if not shutil.which("chattr") or subprocess.run(["chattr", "+i", wal], stderr=subprocess.DEVNULL).returncode:
        service.kill()
        return "skipped: needs root and a file system that knows chattr +i"
    try:
        time.sleep(0.5)
        answer = service.post_job(scene, {**SMALL, "solver": {**SMALL["solver"], "seed": 5}})
        assert answer.status in (500, 503, 507), answer.status
        assert "problem+json" in answer.headers["Content-Type"]
        assert service.ask("GET", f"/v1/jobs/{job}").status == 200
        assert service.ask("GET", "/readyz", port=service.admin_port).status == 503
        assert service.ask("GET", "/healthz", port=service.admin_port).status == 200
    finally:
        subprocess.run(["chattr", "-i", wal], check=True)
    assert service.wait(running, 120)["state"] == "succeeded"
    assert service.ask("GET", "/readyz", port=service.admin_port).status == 200
    assert bakes(service, scene, 6)["state"] == "succeeded"
    assert service.stop() == 0
    return f"POST {answer.status}, reads 200, /readyz 503; afterwards all is well"


def find_faketime(work):
    for folder in (pathlib.Path("/usr/lib/x86_64-linux-gnu"), work / "usr/lib/x86_64-linux-gnu"):
        if (folder / "faketime/libfaketimeMT.so.1").exists():
            return folder / "faketime/libfaketimeMT.so.1"
    work.mkdir(parents=True, exist_ok=True)
    subprocess.run(["apt-get", "download", "libfaketime"], cwd=work, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    for package in work.glob("libfaketime_*.deb"):
        subprocess.run(["dpkg", "-x", str(package), str(work)], check=True)
    found = list(work.glob("usr/lib/*/faketime/libfaketimeMT.so.1"))
    return found[0] if found else None


def clock_jumps(binary, folder, work):
    """The wall clock goes a day forth and two back: jobs, waits and streams go by another clock."""
    library = find_faketime(work)
    if not library:
        return "skipped: libfaketime is not installed, and apt-get can't fetch it"
    clock = folder / "clock"
    clock.write_text("+0\n")
    service = lk.Service(binary, folder / "data", ["--heartbeat-seconds", "1"], wrapper=[
        "env", f"LD_PRELOAD={library}", f"FAKETIME_TIMESTAMP_FILE={clock}", "FAKETIME_NO_CACHE=1",
        "FAKETIME_DONT_FAKE_MONOTONIC=1"])
    scene = lk.scene_bytes(binary, "cornell")
    ids, days = [], []
    long = {"atlas": {"page_size": 1024}, "solver": {"samples": 2048, "direct_samples": 1024}}
    running = service.post_job(scene, long).json["id"]
    for seed, jump in enumerate(("+0", "+1d", "-1d", "+0"), 1):
        clock.write_text(jump + "\n")
        document = bakes(service, scene, seed)
        assert document["state"] == "succeeded", document
        ids.append(document["id"])
        days.append(document["created_at"][:10])
        began = time.monotonic()
        service.ask("GET", f"/v1/jobs/{running}?wait=2")
        assert 1 < time.monotonic() - began < 8, "a wait is as long as it says"
    assert len(set(days)) == 3, f"the clock was not faked: {days}"
    listed = [item["id"] for item in service.ask("GET", "/v1/jobs").json["items"]]
    assert listed == ids[::-1] + [running], "the newest first, by the order of arrival"
    with lk.Wire(service.port, 5) as wire:
        wire.send(f"GET /v1/jobs/{running}/events HTTP/1.1\r\nHost: x\r\n\r\n")
        clock.write_text("-2d\n")
        assert b": hb" in wire.read(b": hb"), "a heartbeat within five seconds"
    assert service.ask("DELETE", f"/v1/jobs/{running}?force=true").status == 204
    assert service.stop() == 0
    return f"jobs of {', '.join(days)} in the order of arrival; waits and heartbeats in time"


def read_only_folder(binary, folder, _):
    """A folder that can't be written ends the start, with the reason."""
    data = folder / "data"
    data.mkdir()
    if os.geteuid() != 0 or subprocess.run(["mount", "-t", "tmpfs", "-o", "ro", "tmpfs", data],
                                           stderr=subprocess.DEVNULL).returncode:
        return "skipped: mounting needs root"
    try:
        ended = subprocess.run([binary, "serve", "--port", "0", "--admin-port", "0", "--data", data],
                               capture_output=True, text=True, timeout=30)
    finally:
        subprocess.run(["umount", data], check=True)
    assert ended.returncode == 1, ended
    assert "Read-only file system" in ended.stderr, ended.stderr
    return "exit code 1: " + ended.stderr.strip().splitlines()[-1]


def main():
    binary, work, failed = sys.argv[1], pathlib.Path(sys.argv[2]), 0
    for fault in (no_memory, store_that_cannot_be_written, clock_jumps, read_only_folder):
        with tempfile.TemporaryDirectory() as folder:
            try:
                print(f"{fault.__name__}: {fault(binary, pathlib.Path(folder), work)}", flush=True)
            except (AssertionError, OSError, http.client.HTTPException) as error:
                failed += 1
                print(f"{fault.__name__}: FAILED: {error}", flush=True)
                import traceback
                traceback.print_exc()
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
