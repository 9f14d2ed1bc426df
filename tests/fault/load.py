#!/usr/bin/env python3
"""What the service does under load: the figures of docs/reliability.md.

  load.py [streams|waiters|uploads|upload|jobs|throughput ...] [--seconds N] [--binary PROGRAM] [--json FILE]

  streams      short requests per second and their times beside 0, 200 and 5,000 event streams of a bake
  waiters      2,000 requests that wait for one job on 8 request threads: how soon all are answered
  uploads      short requests beside 20 and 2,000 uploads of 8 KB/s each: none of them holds a thread
  upload       MB/s of a large upload, and the memory it takes
  jobs         1,000 jobs by 50 clients: none may be lost
  throughput   jobs of a second and more through HTTP beside the same bakes by `lightkiln bake`
"""

import argparse
import json
import multiprocessing
import os
import pathlib
import resource
import select
import socket
import subprocess
import sys
import tempfile
import threading
import time

import service as lk

LONG_BAKE = {"atlas": {"page_size": 1024}, "solver": {"samples": 2048, "direct_samples": 1024}}


def request_loop(port, path, seconds, results):
    """One keep-alive client that asks again as soon as it has its answer."""
    request = f"GET {path} HTTP/1.1\r\nHost: x\r\n\r\n".encode()
    times, buffer = [], bytearray(1 << 16)
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        end = time.perf_counter() + seconds
        while (began := time.perf_counter()) < end:
            connection.sendall(request)
            text = b""
            while b"\r\n\r\n" not in text or len(text) < expected:
                text += bytes(buffer[:connection.recv_into(buffer)])
                if b"\r\n\r\n" in text:
                    head, _, _ = text.partition(b"\r\n\r\n")
                    at = head.lower().index(b"content-length: ") + 16
                    expected = len(head) + 4 + int(head[at:].split(b"\r\n")[0])
                else:
                    expected = 1 << 30
            times.append(time.perf_counter() - began)
            assert text.startswith(b"HTTP/1.1 200"), text[:100]
    results.put(times)


def raise_open_files():
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))


def hold_streams(port, job, count, ready, stop, results):
    """Reads `count` event streams until told to stop."""
    raise_open_files()
    poller, open_streams, events = select.epoll(), {}, 0
    began = time.monotonic()
    for _ in range(count):
        connection = socket.create_connection(("127.0.0.1", port))
        connection.sendall(f"GET /v1/jobs/{job}/events HTTP/1.1\r\nHost: x\r\n\r\n".encode())
        connection.setblocking(False)
        open_streams[connection.fileno()] = connection
        poller.register(connection.fileno(), select.EPOLLIN)
    opened = time.monotonic() - began
    ready.set()
    while not stop.is_set():
        for number, _ in poller.poll(0.1, 512):
            try:
                piece = open_streams[number].recv(1 << 16)
            except BlockingIOError:
                continue
            if not piece:
                poller.unregister(number)
                open_streams.pop(number).close()
            events += piece.count(b"\nevent: ")
    results.put((len(open_streams), events, opened))


def short_requests(service, path, seconds):
    """How soon two clients have their answers."""
    results = multiprocessing.Queue()
    clients = [multiprocessing.Process(target=request_loop, args=(service.port, path, seconds, results))
               for _ in range(2)]
    for client in clients:
        client.start()
    times = [value for _ in clients for value in results.get()]
    for client in clients:
        client.join()
    return {"requests_per_s": round(len(times) / seconds), **lk.summary_ms(times),
            "rss_mib": round(service.rss() / (1 << 20), 1)}


def service_that_bakes(options, folder, *flags):
    """A service and a job that runs on one processor for as long as it is looked at."""
    service = lk.Service(options.binary, folder, ["--threads", "1", "--max-connections-per-address", "0", *flags])
    job = service.post_job(lk.scene_bytes(options.binary, "cornell"), LONG_BAKE).json["id"]
    while service.ask("GET", f"/v1/jobs/{job}").json["state"] != "running":
        time.sleep(0.2)
    return service, job


def beside(service, job, streams, seconds):
    ready, stop, held = multiprocessing.Event(), multiprocessing.Event(), multiprocessing.Queue()
    holder = multiprocessing.Process(target=hold_streams, args=(service.port, job, streams, ready, stop, held))
    holder.start()
    ready.wait(60)
    time.sleep(2)
    row = short_requests(service, f"/v1/jobs/{job}", seconds)
    open_at_end, events, opened = (stop.set(), held.get())[1]
    holder.join()
    return {"streams": streams, "still_open": open_at_end, "opened_in_s": round(opened, 2), "events_read": events,
            **row}


def measure_streams(options, folder):
    """The bake takes one processor; the service, these clients and their streams share the rest."""
    service, job = service_that_bakes(options, folder)
    rows = [beside(service, job, streams, options.seconds) for streams in (0, 200, 5000)]
    ok = all(row["still_open"] == row["streams"] for row in rows) and service.ask("GET", f"/v1/jobs/{job}").json["state"] == "running"
    service.kill()
    return rows, ok


def measure_waiters(options, folder, count=2000):
    """Beside them two clients ask short questions, and the job they wait for keeps changing."""
    raise_open_files()
    service, job = service_that_bakes(options, folder, "--http-threads", "8")
    request = f"GET /v1/jobs/{job}?wait=60 HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n".encode()
    began = time.monotonic()
    sockets = []
    for _ in range(count):
        sockets.append(socket.create_connection(("127.0.0.1", service.port)))
        sockets[-1].sendall(request)
    while service.metric("http_waiting") < count and time.monotonic() - began < 30:
        time.sleep(0.01)
    parked = time.monotonic() - began
    beside_them = short_requests(service, f"/v1/jobs/{job}", options.seconds)
    began = time.monotonic()
    service.ask("POST", f"/v1/jobs/{job}/cancel")
    answered = 0
    for connection in sockets:
        connection.settimeout(30)
        text = b""
        while part := connection.recv(1 << 16):
            text += part
        answered += text.startswith(b"HTTP/1.1 200") and b'"canceled"' in text
        connection.close()
    row = {"waiting": count, "parked_in_s": round(parked, 2), "answered": answered,
           "answered_in_s": round(time.monotonic() - began, 2), **beside_them}
    service.kill()
    return [row], answered == count


def send_slowly(port, count, pieces, rate, ready, results):
    """Uploads that each send a piece a second. Their form has no scene: no process has to read them."""
    raise_open_files()
    part = b'--B\r\nContent-Disposition: form-data; name="x"; filename="x"\r\n\r\n'
    body = part + bytes(pieces * rate - len(part) - 9) + b"\r\n--B--\r\n"
    head = ("POST /v1/scenes HTTP/1.1\r\nHost: x\r\nConnection: close\r\nContent-Type: multipart/form-data; boundary=B\r\n"
            f"Content-Length: {len(body)}\r\n\r\n").encode()
    sockets = []
    for _ in range(count):
        sockets.append(socket.create_connection(("127.0.0.1", port)))
        sockets[-1].sendall(head)
    ready.set()
    began = time.monotonic()
    for index in range(pieces * count):
        late = time.monotonic() - began - index / count
        if late < -0.001:
            time.sleep(-late)
        at = index // count * rate
        sockets[index % count].sendall(body[at:at + rate])
    took = time.monotonic() - began
    answered = 0
    for connection in sockets:
        connection.settimeout(60)
        text = b""
        while part := connection.recv(1 << 16):
            text += part
        answered += text.startswith(b"HTTP/1.1 422") and b"`scene` is missing" in text
    results.put((answered, took))


def measure_uploads(options, folder):
    raise_open_files()
    service = lk.Service(options.binary, folder, ["--max-connections-per-address", "0", "--max-uploads-per-address", "0",
                                                  "--max-uploads-per-tenant", "0"])
    rows, pieces = [], int(options.seconds) + 5
    for count in (20, 2000):
        ready, results = multiprocessing.Event(), multiprocessing.Queue()
        before = service.rss()
        sender = multiprocessing.Process(target=send_slowly, args=(service.port, count, pieces, 8192, ready, results))
        sender.start()
        ready.wait(60)
        time.sleep(2)
        open_now = service.metric("http_uploads")
        growth = (service.rss() - before) / (1 << 20)
        row = short_requests(service, "/v1/jobs", options.seconds)
        answered, took = results.get()
        sender.join()
        rows.append({"uploads": count, "open": open_now, "answered": answered, "sent_in_s": round(took, 1),
                     "rss_growth_mib": round(growth, 1), **row})
    service.kill()
    return rows, all(row["answered"] == row["uploads"] == row["open"] and row["p99_ms"] < 10 for row in rows)


def measure_upload(options, folder):
    service = lk.Service(options.binary, folder)
    path = folder / "large.glb"
    path.write_bytes(lk.large_scene(lk.scene_bytes(options.binary, "cornell"), 500 << 20))
    service.ask("GET", "/v1/jobs")
    before, rows = service.rss(), []
    for how, flags in (("raw", ["-X", "POST", "-H", "Content-Type: model/gltf-binary", "-T", str(path)]),
                       ("multipart, chunked", ["-H", "Transfer-Encoding: chunked", "-F", f"scene=@{path}"])):
        peak, done = [0], threading.Event()

        def watch():
            while not done.wait(0.005):
                peak[0] = max(peak[0], service.rss())

        watcher = threading.Thread(target=watch)
        watcher.start()
        began = time.monotonic()
        answer = subprocess.run(["curl", "-sS", "-o", os.devnull, "-w", "%{http_code}", *flags,
                                 f"http://127.0.0.1:{service.port}/v1/scenes"], capture_output=True, text=True)
        seconds = time.monotonic() - began
        done.set()
        watcher.join()
        size = path.stat().st_size
        rows.append({"how": how, "status": answer.stdout, "mb": round(size / 1e6), "mb_per_s": round(size / 1e6 / seconds),
                     "rss_growth_mib": round((peak[0] - before) / (1 << 20), 1)})
    service.kill()
    return rows, all(row["status"] in ("200", "201") and row["rss_growth_mib"] < 64 for row in rows)


def measure_jobs(options, folder, clients=50, each=20):
    service = lk.Service(options.binary, folder)
    scene = lk.scene_bytes(options.binary, "plane_point")
    accepted, refused, lock = [], [], threading.Lock()

    def client(number):
        for index in range(each):
            settings = {"atlas": {"page_size": 64}, "solver": {"samples": 4, "direct_samples": 2, "seed": number * each + index + 1}}
            answer = service.post_job(scene, settings)
            with lock:
                (accepted if answer.status == 202 else refused).append(answer.json.get("id", answer.status))
            if answer.status == 202:
                service.wait(answer.json["id"], 600)

    began = time.monotonic()
    threads = [threading.Thread(target=client, args=(number,)) for number in range(clients)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    seconds = time.monotonic() - began
    states = [service.ask("GET", f"/v1/jobs/{job}").json["state"] for job in accepted]
    row = {"clients": clients, "accepted": len(accepted), "distinct": len(set(accepted)), "refused": len(refused),
           "succeeded": states.count("succeeded"), "seconds": round(seconds, 1), "jobs_per_s": round(len(accepted) / seconds, 1)}
    service.kill()
    return [row], row["succeeded"] == row["distinct"] == clients * each


def measure_throughput(options, folder, count=8):
    """One after the other, taking turns, so that both meet the same machine."""
    scene = lk.scene_bytes(options.binary, "cornell")
    path = folder / "scene.glb"
    path.write_bytes(scene)
    service = lk.Service(options.binary, folder / "data", ["--max-running-jobs", "1"])
    bare, through = [], []
    for seed in range(1, count + 1):
        settings = {"atlas": {"page_size": 512}, "solver": {"seed": seed}}
        (folder / "settings.json").write_text(json.dumps(settings))
        began = time.monotonic()
        subprocess.run([options.binary, "bake", str(path), "-o", str(folder / f"out{seed}"), "--settings",
                        str(folder / "settings.json"), "-q"], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        bare.append(time.monotonic() - began)
        began = time.monotonic()
        job = service.post_job(scene, settings, {"dedupe": False}).json["id"]
        document = service.wait(job, 600)
        through.append(time.monotonic() - began)
        assert document["state"] == "succeeded", document
    service.kill()
    row = {"bakes": count, "bare_s": round(sum(bare), 2), "service_s": round(sum(through), 2), "bare_median_s": round(lk.quantile(bare, 0.5), 2),
           "share_of_bare": round(sum(bare) / sum(through), 3)}
    return [row], row["share_of_bare"] >= 0.9


def main():
    parts = {"streams": measure_streams, "waiters": measure_waiters, "uploads": measure_uploads, "upload": measure_upload, "jobs": measure_jobs, "throughput": measure_throughput}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=list(parts))
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--binary", default=lk.default_binary())
    parser.add_argument("--json", type=pathlib.Path)
    options = parser.parse_args()
    result, failed = {"machine": lk.machine()}, []
    print(json.dumps(result["machine"]))
    for name in options.parts:
        with tempfile.TemporaryDirectory() as folder:
            rows, ok = parts[name](options, pathlib.Path(folder))
        result[name] = rows
        for row in rows:
            print(name, json.dumps(row), flush=True)
        failed += [] if ok else [name]
    if options.json:
        options.json.write_text(json.dumps(result, indent=1) + "\n")
    if failed:
        print("FAILED:", ", ".join(failed))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
