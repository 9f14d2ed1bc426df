"""Hostile exchanges for campaign.py: each does one with the service, and gives the status of the answer."""

import socket
import threading
import time

import service as lk

UPLOAD_LIMIT = 1 << 20
HEAD = "Host: x\r\n"


class Context:
    def __init__(self, service, scene, tokens, jobs):
        self.service, self.scene, self.tokens, self.jobs = service, scene, tokens, jobs
        self.auth = "Authorization: Bearer " + tokens["a"] + "\r\n"

    def bearer(self, tenant):
        return {"Authorization": "Bearer " + self.tokens[tenant]}

    def say(self, text, body=b""):
        """Status of the answer to these bytes on a connection of their own; 0: closed without one."""
        with lk.Wire(self.service.port, 20) as wire:
            wire.send((text if isinstance(text, bytes) else text.encode("latin-1")) + body)
            return wire.status()

    def post(self, path, body, extra=""):
        return self.say(f"POST {path} HTTP/1.1\r\n{HEAD}{self.auth}{extra}Content-Length: {len(body)}\r\n\r\n", body)


CASES = {}


def case(allowed):
    """`allowed`: the statuses that a right answer may have; 0 is a closed connection."""
    def add(function):
        CASES[function.__name__] = (function, {allowed} if isinstance(allowed, int) else set(allowed))
        return function
    return add


# Framing ---------------------------------------------------------------------------------------


@case(400)
def two_lengths(c, r):
    a, b = r.randrange(100), r.randrange(100)
    return c.say(f"POST /v1/jobs HTTP/1.1\r\n{HEAD}Content-Length: {a}\r\nContent-Length: {b}\r\n\r\n", b"x" * max(a, b))


@case(400)
def length_and_chunks(c, r):
    return c.say(f"POST /v1/jobs HTTP/1.1\r\n{HEAD}Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n")


@case(400)
def length_that_is_none(c, r):
    wrong = r.choice(["-1", "+5", "0x10", "1e3", "99999999999999999999999", "5, 5", "", "5 5"])
    return c.say(f"POST /v1/jobs HTTP/1.1\r\n{HEAD}Content-Length: {wrong}\r\n\r\nhello")


@case({400, 401, 413})
def length_that_lies(c, r):
    """More is announced than comes, then the connection is closed on our side."""
    with lk.Wire(c.service.port, 20) as wire:
        wire.send(f"POST /v1/scenes HTTP/1.1\r\n{HEAD}{c.auth}Content-Length: {r.randrange(100, UPLOAD_LIMIT)}\r\n\r\nglTF")
        wire.socket.shutdown(socket.SHUT_WR)
        return wire.status()


@case(413)
def length_over_the_limit(c, r):
    return c.say(f"POST /v1/scenes HTTP/1.1\r\n{HEAD}{c.auth}Content-Length: {UPLOAD_LIMIT + 1 + r.randrange(1 << 40)}\r\n\r\n", b"x" * 1000)


@case({413, 0})
def chunks_over_the_limit(c, r):
    with lk.Wire(c.service.port, 20) as wire:
        wire.send(f"POST /v1/scenes HTTP/1.1\r\n{HEAD}{c.auth}Transfer-Encoding: chunked\r\n\r\n")
        chunk = b"10000\r\n" + b"x" * 0x10000 + b"\r\n"
        for _ in range(40):
            if not wire.send(chunk):
                break
        return wire.status()


@case(400)
def chunks_that_are_none(c, r):
    wrong = r.choice([b"zz\r\nabc", b"-3\r\nabc\r\n", b"3\nabc\r\n0\r\n\r\n", b"f" * 300 + b"\r\n", b"3\r\nabcd\r\n"])
    return c.say(f"POST /v1/scenes HTTP/1.1\r\n{HEAD}{c.auth}Transfer-Encoding: chunked\r\n\r\n", wrong)


@case({401, 404, 400})
def smuggled_request(c, r):
    """A refused body that looks like a request must not be read as one: one answer, then the end."""
    inner = f"DELETE /v1/jobs/{c.jobs[0]}?force=true HTTP/1.1\r\n{HEAD}{c.auth}\r\n"
    with lk.Wire(c.service.port, 20) as wire:
        path = r.choice(["/v1/jobs", "/nothing"])
        wire.send(f"POST {path} HTTP/1.1\r\n{HEAD}Content-Length: {len(inner)}\r\n\r\n{inner}")
        text = wire.read()
    return int(text[9:12]) if text.count(b"HTTP/1.1 ") == 1 else -1


@case(400)
def body_on_get(c, r):
    return c.say(f"{r.choice(['GET', 'DELETE'])} /v1/jobs HTTP/1.1\r\n{HEAD}Content-Length: 4\r\n\r\nGET ")


# Heads -----------------------------------------------------------------------------------------


@case({431, 0})
def endless_header(c, r):
    with lk.Wire(c.service.port, 20) as wire:
        wire.send("GET / HTTP/1.1\r\nA: ")
        for _ in range(20):
            if not wire.send(b"a" * 8192):
                break
        return wire.status()


@case({431, 0})
def headers_without_number(c, r):
    return c.say("GET / HTTP/1.1\r\n" + HEAD + "A: b\r\n" * r.randrange(150, 3000) + "\r\n")


@case(414)
def endless_path(c, r):
    return c.say("GET /" + "p/" * r.randrange(300, 3000) + f" HTTP/1.1\r\n{HEAD}\r\n")


@case({400, 405, 0})
def no_http(c, r):
    return c.say(r.choice([
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(r.randrange(256) for _ in range(200)) + b"\r\n\r\n",
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", b"\r\n\r\n\r\n\r\n", b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n",
        bytes(r.randrange(256) for _ in range(500)) + b"\r\n\r\n", b"GET / HTTP/1.1\nHost: x\n\n\r\n\r\n",
        b"CONNECT evil:443 HTTP/1.1\r\nHost: x\r\n\r\n", b"GET /\x00 HTTP/1.1\r\nHost: x\r\n\r\n"]))


@case(400)
def odd_headers(c, r):
    odd = r.choice(["Host: y", "A : b", " folded: x", "A\x01: b", "A: b\x00c", "no colon", ": empty"])
    return c.say(f"GET /v1/jobs HTTP/1.1\r\n{HEAD}{odd}\r\n\r\n")


# Names and ids ---------------------------------------------------------------------------------


@case({400, 404, 405, 414})
def path_tricks(c, r):
    path = r.choice(["/v1/jobs/../../etc/passwd", "/v1/jobs/%2e%2e/%2e%2e/etc/passwd", "/../../../../etc/shadow",
                     "/v1/jobs/..%2f..%2fetc%2fpasswd", "/v1/jobs/" + "%00" * 26, "/v1/jobs/job_" + "A" * 26,
                     f"/v1/jobs/{c.jobs[0]}/results/../../../jobs.db", f"/v1/jobs/{c.jobs[0]}/results/%2e%2e%2fjobs.db",
                     f"/v1/jobs/{c.jobs[0]}/results/..", "/v1/jobs//events", "/v1//jobs/", "//evil.example/v1/jobs/x",
                     "/v1/scenes/sha256:" + "../" * 10, "/v1/scenes/sha256:" + "0" * 63, "/v1/jobs/%", "/v1/jobs/%zz",
                     "/v1/jobs/job_' OR 1=1 --", "/v1/jobs/job_" + "0" * 26 + "/results/page_00.exr"])
    return c.say(f"GET {path.replace(' ', '%20')} HTTP/1.1\r\n{HEAD}{c.auth}\r\n")


@case({400, 422})
def names_of_side_files(c, r):
    name = r.choice(["../../../../etc/cron.d/x", "/etc/passwd", "..", ".", "a/../../b", "\x01", "x" * 2000, "", "CON"])
    body = (b'--B\r\nContent-Disposition: form-data; name="f"; filename="' + name.encode() +
            b'"\r\n\r\nx\r\n--B\r\nContent-Disposition: form-data; name="scene"; filename="s.gltf"\r\n\r\n'
            b'{"asset":{"version":"2.0"},"buffers":[{"byteLength":1,"uri":"../../../../etc/passwd"}]}\r\n--B--\r\n')
    return c.post("/v1/jobs", body, "Content-Type: multipart/form-data; boundary=B\r\n")


@case(404)
def foreign_ids(c, r):
    """Of another tenant: as if there were none."""
    verb, path = r.choice([("GET", ""), ("GET", "/events"), ("GET", "/results"), ("GET", "/results/page_00.exr"),
                           ("GET", "/preview"), ("POST", "/cancel"), ("POST", "/retry"), ("DELETE", ""),
                           ("DELETE", "?force=true"), ("GET", "?wait=60"), ("GET", "/results.zip")])
    return c.say(f"{verb} /v1/jobs/{c.jobs[0]}{path} HTTP/1.1\r\n{HEAD}Authorization: Bearer {c.tokens['b']}\r\n\r\n")


@case(401)
def tokens_that_are_none(c, r):
    wrong = r.choice(["", "Bearer", "Bearer ", "Basic YTpi", "Bearer lk_" + "0" * 52, "Bearer " + "x" * 5000,
                      "Bearer " + c.tokens["a"][:-1], "Bearer ' OR ''='", "bearer\t" + c.tokens["a"][:-2]])
    return c.say(f"GET /v1/jobs HTTP/1.1\r\n{HEAD}Authorization: {wrong}\r\n\r\n")


# Bodies ----------------------------------------------------------------------------------------


@case({400, 422})
def part_bomb(c, r):
    body = b"".join(b'--B\r\nContent-Disposition: form-data; name="f"; filename="%d"\r\n\r\nx\r\n' % i for i in range(r.randrange(257, 900)))
    return c.post("/v1/scenes", body + b"--B--\r\n", "Content-Type: multipart/form-data; boundary=B\r\n")


@case({400, 422})
def part_heads_of_8_kb(c, r):
    head = b'--B\r\nContent-Disposition: form-data; name="f%d"; filename="%d"; ' + b"a" * r.randrange(7000, 9000) + b'="b"\r\n\r\nx\r\n'
    body = b"".join(head % (i, i) for i in range(r.randrange(1, 40)))
    return c.post("/v1/scenes", body + b"--B--\r\n", "Content-Type: multipart/form-data; boundary=B\r\n")


@case({400, 413, 422})
def nested_json(c, r):
    depth = r.choice([100, 10_000, 200_000])
    text = r.choice([b"[" * depth, b'{"a":' * depth, b"[" * depth + b"]" * depth, b'{"settings":' + b"[" * depth + b"]" * depth + b"}"])
    return c.post("/v1/jobs", text, "Content-Type: application/json\r\n")


@case({400, 422})
def odd_json(c, r):
    text = r.choice([b'{"scene":"\xff\xfe"}', b'{"scene":"\\ud800"}', b"\xef\xbb\xbf{", b'{"priority":1e999}', b'{"priority":"\x00"}',
                     b'{"priority":1,"priority":2}', b"nul", b"[]", b"123", b'"x"', b'{"labels":{"' + b"x" * 100_000 + b'":"y"}}',
                     b'{"settings":{"solver":{"samples":-1}}}', b'{"scene":"sha256:' + b"0" * 64 + b'"}', b"{}" * 1000])
    # A scene that nobody has is 404.
    status = c.post("/v1/jobs", text, "Content-Type: application/json\r\n")
    return 422 if status == 404 else status


@case({400, 422})
def scenes_that_are_none(c, r):
    cut = bytearray(c.scene[:r.randrange(4, len(c.scene))])
    for _ in range(r.randrange(1, 20)):
        cut[r.randrange(len(cut))] = r.randrange(256)
    return c.post("/v1/jobs", bytes(cut), "Content-Type: model/gltf-binary\r\n")


@case(415)
def other_encodings(c, r):
    return c.post("/v1/scenes", b"\x1f\x8b" + bytes(100), r.choice(["Content-Encoding: gzip\r\n", "Content-Encoding: br\r\n", "Content-Type: text/html\r\n"]))


@case({200, 206, 416, 400})
def odd_ranges(c, r):
    value = r.choice(["bytes=0-0", "bytes=-1", "bytes=999999999999-", "bytes=0-1,2-3", "bytes=5-1", "bytes=" + "0-1," * 500, "lines=1",
                      "bytes=-99999999999999999999999", "bytes=18446744073709551615-"])
    return c.say(f"GET /v1/jobs/{c.jobs[0]}/results/page_00.exr HTTP/1.1\r\n{HEAD}{c.auth}Range: {value}\r\nConnection: close\r\n\r\n")


# Jobs ------------------------------------------------------------------------------------------


@case({200, 202, 409, 422, 429, 503})
def replayed_keys(c, r):
    """The same key for one body or another, from several threads: never two jobs."""
    key = f"key-{r.randrange(20)}"
    settings = {"atlas": {"page_size": 64}, "solver": {"samples": 1, "direct_samples": 1, "seed": r.randrange(1, 3)}}
    body, headers = lk.form(c.scene, settings)
    return c.service.ask("POST", "/v1/jobs", body, {**headers, **c.bearer("a"), "Idempotency-Key": key}).status


@case({200, 202, 204, 404, 409, 429, 503})
def cancel_storm(c, r):
    settings = {"atlas": {"page_size": 64}, "solver": {"samples": 1, "direct_samples": 1, "seed": r.randrange(1, 1 << 30)}}
    made = c.service.post_job(c.scene, settings, headers=c.bearer("a"))
    if made.status != 202:
        return made.status
    path = "/v1/jobs/" + made.json["id"]
    worst = []

    def storm(verb, target):
        worst.append(c.service.ask(verb, target, headers=c.bearer("a")).status)

    threads = [threading.Thread(target=storm, args=(verb, path + end)) for verb, end in
               (("POST", "/cancel"), ("POST", "/cancel"), ("POST", "/retry"), ("DELETE", "?force=true"), ("GET", "?wait=1"), ("POST", "/cancel"))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    c.service.ask("DELETE", path + "?force=true", headers=c.bearer("a"))
    return max(worst)


# Clients that go ---------------------------------------------------------------------------------


@case(0)
def vanish(c, r):
    """Resets the connection in any phase."""
    body, headers = lk.form(c.scene)
    head = f"POST /v1/scenes HTTP/1.1\r\n{HEAD}{c.auth}Content-Type: {headers['Content-Type']}\r\nContent-Length: {len(body)}\r\n\r\n".encode()
    whole = head + body
    job = f"GET /v1/jobs/{c.jobs[0]}"
    phase = r.choice([b"", b"GET", b"GET / HTTP/1.1\r\nHo", head, whole[:len(head) + r.randrange(len(body))], whole,
                      f"{job}/results/page_00.exr HTTP/1.1\r\n{HEAD}{c.auth}\r\n".encode(),
                      f"{job}/results.zip HTTP/1.1\r\n{HEAD}{c.auth}\r\n".encode(),
                      f"{job}/events HTTP/1.1\r\n{HEAD}{c.auth}\r\n".encode(),
                      f"{job}?wait=60 HTTP/1.1\r\n{HEAD}{c.auth}\r\n".encode(),
                      f"POST /v1/scenes HTTP/1.1\r\n{HEAD}{c.auth}Expect: 100-continue\r\nContent-Length: 99\r\n\r\n".encode()])
    wire = lk.Wire(c.service.port, 20)
    wire.send(phase)
    if r.random() < 0.5:
        time.sleep(r.random() * 0.02)
    wire.vanish()
    return 0


@case({0, 200, 204, 408})
def slow_head(c, r):
    """A few bytes now, a few later, then never: the deadline's business, not a thread's."""
    with lk.Wire(c.service.port, 20) as wire:
        for piece in ("GET / HT", "TP/1.1\r\nHo", "st: "):
            wire.send(piece)
            time.sleep(r.random() * 0.01)
        return 0
