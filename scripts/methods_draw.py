"""Draws what scripts/methods measures: line plots as SVG, and pictures put side by side as PNG. It
needs nothing but Python."""
import math
import struct
import zlib

COLORS = ["#1f6fb4", "#d1495b", "#2e933c", "#8a5fbf", "#c77d0a", "#3d5a6c", "#a23b72", "#5c8001"]
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 640, 380, 70, 170, 40, 50


def _ticks(low, high, log):
    if log:
        return [10.0**e for e in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)]
    step = 10 ** math.floor(math.log10((high - low) or 1))
    while (high - low) / step < 4:
        step /= 2
    return [i * step for i in range(math.floor(low / step), math.ceil(high / step) + 1)]


def plot(path, title, x_label, y_label, series, log_x=True, log_y=True):
    """Writes a plot. series: {name: [(x, y), ...]}"""
    points = [p for line in series.values() for p in line]
    axes = []
    for at, log in ((0, log_x), (1, log_y)):
        values = [p[at] for p in points if not log or p[at] > 0]
        ticks = _ticks(min(values), max(values), log)
        axes.append((ticks[0], ticks[-1] if ticks[-1] > ticks[0] else ticks[0] * 10 + 1, log, ticks))

    def place(value, axis, begin, end):
        low, high, log, _ = axis
        if log:
            value, low, high = (math.log10(max(v, 1e-30)) for v in (value, low, high))
        return begin + (value - low) / (high - low) * (end - begin)

    def x_of(x):
        return place(x, axes[0], LEFT, WIDTH - RIGHT)

    def y_of(y):
        return place(y, axes[1], HEIGHT - BOTTOM, TOP)

    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" '
           'font-family="sans-serif" font-size="12">',
           f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
           f'<text x="{LEFT}" y="22" font-size="14">{title}</text>']
    for tick in axes[0][3]:
        x = x_of(tick)
        out.append(f'<path d="M{x:.1f} {TOP}V{HEIGHT - BOTTOM}" stroke="#ddd"/>'
                   f'<text x="{x:.1f}" y="{HEIGHT - BOTTOM + 16}" text-anchor="middle">{tick:g}</text>')
    for tick in axes[1][3]:
        y = y_of(tick)
        out.append(f'<path d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}" stroke="#ddd"/>'
                   f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{tick:g}</text>')
    middle = (TOP + HEIGHT - BOTTOM) / 2
    out.append(f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 12}" text-anchor="middle">'
               f'{x_label}</text>'
               f'<text transform="translate(16 {middle}) rotate(-90)" text-anchor="middle">'
               f'{y_label}</text>')
    for i, (name, line) in enumerate(series.items()):
        color = COLORS[i % len(COLORS)]
        drawn = [p for p in line if (p[0] > 0 or not log_x) and (p[1] > 0 or not log_y)]
        path_of = " ".join(f"{x_of(x):.1f},{y_of(y):.1f}" for x, y in drawn)
        out.append(f'<polyline points="{path_of}" fill="none" stroke="{color}" stroke-width="2"/>')
        out += [f'<circle cx="{x_of(x):.1f}" cy="{y_of(y):.1f}" r="3" fill="{color}"/>'
                for x, y in drawn]
        y = TOP + 10 + 18 * i
        out.append(f'<rect x="{WIDTH - RIGHT + 12}" y="{y - 9}" width="10" height="10" '
                   f'fill="{color}"/><text x="{WIDTH - RIGHT + 28}" y="{y}">{name}</text>')
    out.append("</svg>")
    path.write_text("\n".join(out) + "\n")


def read_png(path):
    """Returns width, height and rows of RGB bytes of an 8-bit PNG without interlacing."""
    data = path.read_bytes()
    at, packed, header = 8, b"", None
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + length]
        if kind == b"IHDR":
            header = struct.unpack(">IIBBBBB", body)
        elif kind == b"IDAT":
            packed += body
        at += 12 + length
    width, height, depth, color = header[:4]
    channels = {0: 1, 2: 3, 6: 4}[color]
    if depth != 8:
        raise ValueError(f"{path} has {depth} bits")
    raw, stride = zlib.decompress(packed), width * channels
    rows, before = [], bytearray(stride)
    for y in range(height):
        kind = raw[y * (stride + 1)]
        row = bytearray(raw[y * (stride + 1) + 1:(y + 1) * (stride + 1)])
        for i in range(stride):
            a = row[i - channels] if i >= channels else 0
            b, c = before[i], before[i - channels] if i >= channels else 0
            if kind == 1:
                row[i] = (row[i] + a) & 255
            elif kind == 2:
                row[i] = (row[i] + b) & 255
            elif kind == 3:
                row[i] = (row[i] + (a + b) // 2) & 255
            elif kind == 4:
                p, q, r = abs(b - c), abs(a - c), abs(a + b - 2 * c)
                row[i] = (row[i] + (a if p <= q and p <= r else b if q <= r else c)) & 255
        before = row
        rows.append(bytes(row) if channels == 3 else
                    b"".join(bytes(row[i:i + 1]) * 3 if channels == 1 else bytes(row[i:i + 3])
                             for i in range(0, stride, channels)))
    return width, height, rows


def write_png(path, width, rows):
    def chunk(kind, body):
        return (struct.pack(">I", len(body)) + kind + body +
                struct.pack(">I", zlib.crc32(kind + body)))

    header = struct.pack(">IIBBBBB", width, len(rows), 8, 2, 0, 0, 0)
    body = zlib.compress(b"".join(b"\0" + row for row in rows), 9)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", body) +
                     chunk(b"IEND", b""))


def sheet(path, lines, side):
    """Writes pictures in lines below each other. Each is enlarged to about `side` pixels, by whole
    numbers, so that texels stay squares."""
    gap, gray = 6, b"\x30\x38\x40"
    out, width = [], 0
    for line in lines:
        tiles = []
        for source in line:
            w, h, rows = read_png(source)
            k = max(1, round(side / max(w, h)))
            tiles.append((w * k, [b"".join(row[3 * x:3 * x + 3] * k for x in range(w))
                                  for row in rows for _ in range(k)]))
        height = max(len(rows) for _, rows in tiles)
        for y in range(height):
            out.append((gray * gap).join(rows[y] if y < len(rows) else gray * w
                                         for w, rows in tiles))
        out += [b""] * gap
        width = max(width, sum(w for w, _ in tiles) + gap * (len(tiles) - 1))
    write_png(path, width, [row + gray * (width - len(row) // 3) for row in out[:-gap]])
