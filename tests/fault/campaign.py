#!/usr/bin/env python3
"""Hostile traffic against a service of its own: what it must answer, and that everyone else is still
served meanwhile. Every case is an exchange that some client, scanner or attacker sends.

  campaign.py [--binary PROGRAM] [--requests N] [--half-open N] [--threads N] [--json FILE]

Ends with a table and exit code 0 when all answers were right, /healthz answered within 100 ms
throughout (--health-ms), memory grew by less than 32 MB (--growth-mib), and no descriptor, file or
job stayed behind."""

import argparse
import collections
import json
import pathlib
import random
import subprocess
import sys
import tempfile
import threading
import time

import service as lk
from cases import CASES, Context, UPLOAD_LIMIT


class HalfOpen:
    """Connections that say a little or nothing and stay."""

    def __init__(self, port, count):
        self.wires = []
        for i in range(count):
            wire = lk.Wire(port, 20)
            if i % 3 == 1:
                wire.send("GET / HTTP/1.1\r\nHost:")
            if i % 3 == 2:
                wire.send("POST /v1/scenes HTTP/1.1\r\nHost: x\r\nContent-Len")
            self.wires.append(wire)

    def close(self):
        for wire in self.wires:
            wire.close()


def run_cases(context, requests, threads, seed):
    counts, wrong, lock = collections.Counter(), [], threading.Lock()
    names = sorted(CASES)
    todo = iter(range(requests))

    def work(number):
        random_numbers = random.Random(seed * 1000 + number)
        while True:
            with lock:
                index = next(todo, None)
            if index is None or len(wrong) > 20:
                return
            name = names[index % len(names)]
            function, allowed = CASES[name]
            try:
                status = function(context, random_numbers)
            except OSError as error:
                status = f"{type(error).__name__}: {error}"
            with lock:
                counts[name] += 1
                if status not in allowed:
                    wrong.append((name, status))

    workers = [threading.Thread(target=work, args=(number,)) for number in range(threads)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    return counts, wrong


def settle(service, data, descriptors):
    """Waits until what the campaign left has been let go of. Checked scenes are kept for 15 s."""
    for _ in range(300):
        if service.descriptors() <= descriptors + 8 and not any((data / "tmp").iterdir()):
            return service.descriptors()
        time.sleep(0.1)
    return service.descriptors()


def token(binary, data, tenant):
    return subprocess.run([binary, "token", "create", "--tenant", tenant, "--data", str(data)], check=True,
                          capture_output=True, text=True).stdout.strip()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", default=lk.default_binary())
    parser.add_argument("--requests", type=int, default=24_000)
    parser.add_argument("--half-open", type=int, default=3_000)
    parser.add_argument("--threads", type=int, default=8)
    parser.add_argument("--health-ms", type=float, default=100)
    parser.add_argument("--growth-mib", type=float, default=32)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=pathlib.Path)
    options = parser.parse_args()

    with tempfile.TemporaryDirectory() as folder:
        data = pathlib.Path(folder) / "data"
        tokens = {tenant: token(options.binary, data, tenant) for tenant in ("a", "b")}
        service = lk.Service(options.binary, data, [
            "--max-upload-bytes", str(UPLOAD_LIMIT), "--max-request-json-bytes", "512KiB", "--threads", "1",
            "--max-queued-jobs", "200"])
        try:
            return campaign(options, service, tokens, data)
        finally:
            service.kill()


def campaign(options, service, tokens, data):
    scene = lk.scene_bytes(options.binary, "cornell")
    settings = {"atlas": {"page_size": 64}, "solver": {"samples": 4, "direct_samples": 2}}
    bearer = {"Authorization": "Bearer " + tokens["a"]}
    job = service.post_job(scene, settings, headers=bearer).json["id"]
    assert service.wait(job, headers=bearer)["state"] == "succeeded"
    context = Context(service, scene, tokens, [job])
    run_cases(context, 4 * len(CASES), options.threads, 99)  # what the first of each takes is not growth
    time.sleep(16)
    before, descriptors = service.rss(), service.descriptors()

    prober = lk.Prober(service.admin_port)
    began = time.monotonic()
    half_open = HalfOpen(service.port, options.half_open)
    counts, wrong = run_cases(context, options.requests, options.threads, options.seed)
    seconds = time.monotonic() - began
    half_open.close()
    health = prober.finish()
    left = settle(service, data, descriptors)
    after = service.rss()
    tmp_left = len(list((data / "tmp").iterdir()))

    # And the service still does what it is for.
    last = service.post_job(scene, {**settings, "solver": {**settings["solver"], "seed": 77}}, headers=bearer)
    works = last.status == 202 and service.wait(last.json["id"], headers=bearer)["state"] == "succeeded"
    kept = service.ask("GET", f"/v1/jobs/{job}", headers=bearer).status == 200
    result = {
        "machine": lk.machine(), "requests": sum(counts.values()), "half_open": options.half_open,
        "seconds": round(seconds, 1), "wrong": wrong[:20], "health": health, "health_failures": prober.failures,
        "rss_before_mib": round(before / (1 << 20), 1), "rss_after_mib": round(after / (1 << 20), 1),
        "descriptors_before": descriptors, "descriptors_after": left,
        "tmp_left": tmp_left, "works_after": works and kept and service.alive()}
    growth = (after - before) / (1 << 20)
    failures = [text for bad, text in (
        (wrong, f"{len(wrong)} wrong answers: {wrong[:5]}"),
        (prober.failures, f"/healthz failed {prober.failures} times"),
        (health["max_ms"] > options.health_ms, f"/healthz took {health['max_ms']} ms"),
        (growth > options.growth_mib, f"memory grew by {growth:.1f} MiB"),
        (left > descriptors + 8, f"{left - descriptors} descriptors stayed open"),
        (result["tmp_left"], "uploads were left in tmp/"), (not result["works_after"], "it does not work any more")) if bad]
    print(json.dumps(result, indent=1))
    for name in sorted(counts):
        print(f"  {name:28} {counts[name]}")
    print(f"{result['requests']} requests in {seconds:.0f} s; /healthz at most {health['max_ms']} ms; memory {growth:+.1f} MiB")
    if options.json:
        options.json.write_text(json.dumps(result, indent=1) + "\n")
    if failures:
        print("\n".join(service.log[-20:]))
    for text in failures:
        print("FAILED:", text)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
