#!/usr/bin/env python3
"""Hours in the life of a service, at once: clients that upload, bake, watch, fetch, cancel and delete
without a pause, while its memory and descriptors are written down.

  soak.py [--minutes N] [--clients N] [--binary PROGRAM] [--json FILE]

Ends with exit code 0 when no request failed that should not, and the second half took no more memory
(--growth-mib) and descriptors than the first."""

import argparse
import collections
import json
import pathlib
import random
import sys
import tempfile
import threading
import time

import service as lk


class Clients:
    def __init__(self, service, scenes, count):
        self.service, self.scenes = service, scenes
        self.end = threading.Event()
        self.counts, self.wrong, self.lock = collections.Counter(), [], threading.Lock()
        self.threads = [threading.Thread(target=self.work, args=(number,)) for number in range(count)]
        for thread in self.threads:
            thread.start()

    def note(self, what, ok, detail=""):
        with self.lock:
            self.counts[what] += 1
            if not ok:
                self.wrong.append(f"{what}: {detail}")

    def work(self, number):
        chance = random.Random(number)
        while not self.end.is_set():
            try:
                self.one_job(chance)
            except OSError as error:
                self.note("connection", False, repr(error))

    def one_job(self, chance):
        service = self.service
        settings = {"atlas": {"page_size": 64}, "solver": {"samples": 8, "direct_samples": 4, "seed": chance.randrange(1, 1 << 30)}}
        answer = service.post_job(chance.choice(self.scenes), settings)
        self.note("post", answer.status in (200, 202), answer.body[:200])
        if answer.status not in (200, 202):
            return time.sleep(0.2)
        job = answer.json["id"]
        path = "/v1/jobs/" + job
        if chance.random() < 0.2:
            self.note("cancel", service.ask("POST", path + "/cancel").status in (200, 202))
        if chance.random() < 0.5:
            seen = lk.events(service, job)
            self.note("stream", bool(seen) and seen[-1][1] == "job.end", seen[-1:])
        document = service.wait(job)
        self.note("wait", document["state"] in ("succeeded", "canceled"), document)
        if document["state"] == "succeeded":
            for name in ("page_00.exr", "lit.glb", "manifest.json"):
                self.note("fetch", service.ask("GET", f"{path}/results/{name}").status == 200, name)
            self.note("zip", service.ask("GET", path + "/results.zip").status == 200)
            self.note("preview", service.ask("GET", path + "/preview").status == 200)
        self.note("list", service.ask("GET", "/v1/jobs?limit=20").status == 200)
        self.note("delete", service.ask("DELETE", path).status == 204)

    def stop(self):
        self.end.set()
        for thread in self.threads:
            thread.join()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30)
    parser.add_argument("--clients", type=int, default=8)
    parser.add_argument("--growth-mib", type=float, default=16)
    parser.add_argument("--binary", default=lk.default_binary())
    parser.add_argument("--json", type=pathlib.Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        service = lk.Service(options.binary, pathlib.Path(name) / "data", ["--leftover-ttl-seconds", "30"])
        scenes = [lk.scene_bytes(options.binary, which) for which in ("cornell", "room_textured", "plane_point")]
        clients = Clients(service, scenes, options.clients)
        began, samples = time.monotonic(), []
        while time.monotonic() - began < options.minutes * 60 and service.alive():
            time.sleep(min(5, options.minutes * 6))
            samples.append({"seconds": round(time.monotonic() - began), "rss_mib": round(service.rss() / (1 << 20), 1),
                            "descriptors": service.descriptors(), "jobs": clients.counts["delete"]})
        clients.stop()
        alive = service.alive()
        service.kill()
    # What a start takes is over after the first sixth.
    settled = samples[len(samples) // 6:]
    half = len(settled) // 2
    high = lambda part, key: max((sample[key] for sample in part), default=0)
    growth = high(settled[half:], "rss_mib") - high(settled[:half], "rss_mib")
    more = high(settled[half:], "descriptors") - high(settled[:half], "descriptors")
    result = {"machine": lk.machine(), "minutes": options.minutes, "clients": options.clients,
              "counts": dict(clients.counts), "wrong": clients.wrong[:20], "rss_growth_mib": round(growth, 1),
              "descriptor_growth": more, "samples": samples[::max(1, len(samples) // 30)], "alive": alive}
    print(json.dumps(result, indent=1))
    print(f"{options.minutes} minutes, {clients.counts['delete']} jobs from post to delete, {len(clients.wrong)} wrong; "
          f"highest memory of the second half {growth:+.1f} MiB against the first, descriptors {more:+d}")
    if options.json:
        options.json.write_text(json.dumps(result, indent=1) + "\n")
    return 1 if clients.wrong or growth > options.growth_mib or more > 16 or not alive else 0


if __name__ == "__main__":
    sys.exit(main())
