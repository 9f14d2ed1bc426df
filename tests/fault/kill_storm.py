#!/usr/bin/env python3
"""SIGKILLs the service at random moments while jobs run, and starts it again each time.

  kill_storm.py [--kills N] [--seed N] [--binary PROGRAM] [--json FILE]

Ends with exit code 0 when no accepted job was lost, no finished pass was baked twice, every event of
every job came once and without holes, and all pages are bit for bit those of a run that nobody
disturbed."""

import argparse
import http.client
import json
import pathlib
import random
import sys
import tempfile
import time

import service as lk

SEEDS = 5
IN_FLIGHT = 6


def settings(seed):
    return {"atlas": {"page_size": 96}, "solver": {"samples": 64, "direct_samples": 16, "seed": seed}}


def digest(service, job):
    files = service.ask("GET", f"/v1/jobs/{job}/results").json["files"]
    return next(f["sha256"] for f in files if f["name"] == "page_00.exr")


def reference(binary, folder, scene):
    """The digests of an undisturbed run, by seed; and the seconds that a job takes."""
    service = lk.Service(binary, folder)
    digests, began = {}, time.monotonic()
    for seed in range(SEEDS):
        job = service.post_job(scene, settings(seed), {"dedupe": False}).json["id"]
        assert service.wait(job, 300)["state"] == "succeeded"
        digests[seed] = digest(service, job)
    seconds = (time.monotonic() - began) / SEEDS
    assert service.stop() == 0
    return digests, seconds


class Client:
    """Posts jobs until the kills are over. A post without an answer is sent again, with its key."""

    def __init__(self, scene):
        self.scene, self.accepted, self.posted, self.unanswered = scene, {}, 0, []

    def post(self, service, key, seed):
        try:
            answer = service.post_job(self.scene, settings(seed), {"dedupe": False}, {"Idempotency-Key": key})
        except (OSError, http.client.HTTPException):
            self.unanswered.append((key, seed))
            return
        assert answer.status == 202 or answer.headers.get("Idempotent-Replayed"), (answer.status, answer.body)
        self.accepted[answer.json["id"]] = seed

    def top_up(self, service):
        again, self.unanswered = self.unanswered, []
        for key, seed in again:
            self.post(service, key, seed)
        try:
            waiting = sum(len(service.ask("GET", f"/v1/jobs?limit=200&state={state}").json["items"])
                          for state in ("queued", "preparing", "running", "finalizing"))
        except (OSError, http.client.HTTPException):
            return
        for _ in range(max(0, IN_FLIGHT - waiting)):
            self.posted += 1
            self.post(service, f"job-{self.posted}", self.posted % SEEDS)


def check(service, client, digests):
    """What is wrong with the jobs after the storm, once they are over."""
    wrong, given_up, passes, attempts = [], [], 0, 0
    listed, cursor = set(), ""
    while True:
        page = service.ask("GET", f"/v1/jobs?limit=200{cursor}").json
        listed.update(item["id"] for item in page["items"])
        if not page["next_cursor"]:
            break
        cursor = "&cursor=" + page["next_cursor"]
    wrong += [f"{job}: lost" for job in client.accepted if job not in listed]
    wrong += [f"{job}: nobody asked for it" for job in listed if job not in client.accepted]
    for job, seed in client.accepted.items():
        document = service.wait(job, 300)
        if document["state"] == "failed" and document["error"]["code"] == "worker_lost":
            given_up.append(job)  # see above; its checkpoints are there
            assert service.ask("POST", f"/v1/jobs/{job}/retry").status == 202
            document = service.wait(job, 300)
        attempts += document["attempt"]
        if document["state"] != "succeeded":
            wrong.append(f"{job}: {document['state']} {document['error']}")
            continue
        events = lk.events(service, job)
        if [number for number, _, _ in events] != list(range(1, len(events) + 1)):
            wrong.append(f"{job}: events with holes")
        indices = [json.loads(data)["index"] for _, kind, data in events if kind == "pass.completed"]
        passes += len(indices)
        if sorted(set(indices)) != indices:
            wrong.append(f"{job}: a pass was made twice: {indices}")
        if digest(service, job) != digests[seed]:
            wrong.append(f"{job}: other pixels")
    return wrong, given_up, passes, attempts


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--binary", default=lk.default_binary())
    parser.add_argument("--json", type=pathlib.Path)
    options = parser.parse_args()
    chance = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        scene = lk.scene_bytes(options.binary, "cornell")
        digests, seconds = reference(options.binary, folder / "calm", scene)
        client = Client(scene)
        began = time.monotonic()
        service = None
        for kill in range(options.kills):
            service = lk.Service(options.binary, folder / "storm")
            client.top_up(service)
            # Anywhere in a job's life. Every other time long enough for a pass: a job that has ended
            # the service three times at the same pass is given up, by design.
            time.sleep(max(0.3, seconds) * (2 * chance.random() if kill % 2 else 2 + chance.random()))
            service.kill()
        service = lk.Service(options.binary, folder / "storm")
        client.top_up(service)
        wrong, given_up, passes, attempts = check(service, client, digests)
        took = time.monotonic() - began
        assert service.stop() == 0
        service = lk.Service(options.binary, folder / "storm")  # what it clears away, it clears at start
        left = [str(path.relative_to(folder)) for path in (folder / "storm/jobs").glob("*/checkpoints")]
        left += [str(path.relative_to(folder)) for path in (folder / "storm/tmp").iterdir()]
        service.stop()
    result = {"machine": lk.machine(), "kills": options.kills, "jobs": len(client.accepted), "passes": passes,
              "attempts": attempts, "given_up_and_retried": len(given_up), "seconds": round(took, 1), "wrong": wrong, "left": left}
    print(json.dumps(result, indent=1))
    print(f"{options.kills} kills over {len(client.accepted)} jobs in {attempts} attempts and {passes} passes: "
          f"{len(wrong)} wrong, {len(left)} files left")
    if options.json:
        options.json.write_text(json.dumps(result, indent=1) + "\n")
    return 1 if wrong or left else 0


if __name__ == "__main__":
    sys.exit(main())
