"""The report of a run as one page of HTML that needs nothing else."""
import html
import statistics

COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b", "#e377c2",
           "#7f7f7f", "#bcbd22")
STYLE = """body{font:14px/1.4 sans-serif;margin:2em;max-width:75em;color:#222}
table{border-collapse:collapse;margin:1em 0}td,th{border:1px solid #ccc;padding:2px 8px;text-align:right}
td:first-child,th:first-child{text-align:left}.good{color:#176d17}.bad{color:#b00020}
svg{background:#fafafa;border:1px solid #ddd;margin:4px}figure{display:inline-block;margin:0 1em 1em 0}
code{background:#f0f0f0;padding:0 3px}figcaption{font-weight:bold}"""


def escape(text):
    return html.escape(str(text))


def merged(results, figure):
    """key -> {n, max, values} of all scenarios together."""
    found = {}
    for result in results:
        for key, one in result["figures"].get(figure, {}).items():
            of = found.setdefault(key, {"n": 0, "max": 0.0, "values": []})
            of["n"] += one["n"]
            of["max"] = max(of["max"], one["max"])
            of["values"] += one["values"]
    return found


def quantile(values, part):
    values = sorted(values)
    return values[min(len(values) - 1, int(part * len(values)))]


def table(head, rows):
    lines = ["<tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in head) + "</tr>"]
    lines += ["<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows]
    return "<table>" + "".join(lines) + "</table>"


def ms(value):
    return f"{value * 1000:,.0f}" if value >= 0.01 else f"{value * 1000:.2f}"


# --- Plots -----------------------------------------------------------------------------------

def svg(width, height, parts):
    return (f'<svg width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
            f'xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" font-size="11">{"".join(parts)}</svg>')


def figure(title, picture):
    return f"<figure><figcaption>{escape(title)}</figcaption>{picture}</figure>"


def strips(values):
    """One line of dots for each key, on one axis of seconds: key -> list."""
    keys = sorted(values)
    top = max((max(v) for v in values.values() if v), default=1.0) or 1.0
    width, left, row = 620, 130, 16
    parts = []
    for i, key in enumerate(keys):
        y = 12 + row * i
        parts.append(f'<text x="{left - 6}" y="{y + 4}" text-anchor="end">{escape(key)}</text>')
        parts.append(f'<line x1="{left}" y1="{y}" x2="{width - 10}" y2="{y}" stroke="#e5e5e5"/>')
        shown = sorted(values[key])[::max(1, len(values[key]) // 200)]
        parts += [f'<circle cx="{left + v / top * (width - left - 20):.1f}" cy="{y}" r="2.5" '
                  f'fill="{COLOURS[i % len(COLOURS)]}" fill-opacity="0.5"/>' for v in shown]
    bottom = 12 + row * len(keys)
    for i in range(5):
        x = left + i / 4 * (width - left - 20)
        parts.append(f'<text x="{x}" y="{bottom + 10}" text-anchor="middle">{top * i / 4:.2g} s</text>')
    return svg(width, bottom + 18, parts)


def histogram(values):
    """Of one list of seconds."""
    if not values:
        return "<p>none</p>"
    bins, width, height = 40, 420, 160
    top = max(values) or 1e-3
    counts = [0] * bins
    for value in values:
        counts[min(bins - 1, int(value / top * bins))] += 1
    parts = [f'<rect x="{10 + i * 10}" y="{height - 20 - n / max(counts) * (height - 40):.1f}" width="9" '
             f'height="{n / max(counts) * (height - 40):.1f}" fill="{COLOURS[0]}"/>' for i, n in enumerate(counts)]
    parts += [f'<text x="10" y="{height - 6}">0</text>',
              f'<text x="{width - 8}" y="{height - 6}" text-anchor="end">{top:.3g} s</text>',
              f'<text x="10" y="12">{len(values)} values, median {statistics.median(values) * 1000:.3g} ms</text>']
    return svg(width, height, parts)


def lines(series, unit, scale):
    """Named lists of (time, value)."""
    width, height, left = 620, 200, 60
    points = [p for of in series.values() for p in of]
    if not points:
        return "<p>none</p>"
    end, top = max(t for t, _ in points) or 1, max(v for _, v in points) * 1.1 or 1
    parts = []
    for i, (name, of) in enumerate(sorted(series.items())):
        of = of[::max(1, len(of) // 300)]
        path = " ".join(f"{left + t / end * (width - left - 10):.1f},{height - 20 - v / top * (height - 40):.1f}"
                        for t, v in of)
        parts.append(f'<polyline points="{path}" fill="none" stroke="{COLOURS[i % len(COLOURS)]}">'
                     f"<title>{escape(name)}</title></polyline>")
        parts.append(f'<text x="{left + i % 5 * 110}" y="{height + 12 + i // 5 * 14}" '
                     f'fill="{COLOURS[i % len(COLOURS)]}">{escape(name)}</text>')
    for i in range(3):
        y = height - 20 - i / 2.2 * (height - 40)
        parts.append(f'<text x="{left - 4}" y="{y}" text-anchor="end">{top * i / 2.2 / scale:.3g} {unit}</text>')
    parts.append(f'<text x="{width - 8}" y="{height - 4}" text-anchor="end">{end:.0f} s</text>')
    return svg(width, height + 4 + 14 * -(-len(series) // 5), parts)


def bars(counts):
    width, left, row = 420, 130, 15
    top = max(counts.values(), default=1)
    parts = []
    for i, (name, n) in enumerate(sorted(counts.items(), key=lambda item: -item[1])):
        y = 4 + row * i
        parts.append(f'<text x="{left - 6}" y="{y + 10}" text-anchor="end">{escape(name)}</text>'
                     f'<rect x="{left}" y="{y}" width="{n / top * (width - left - 50):.1f}" height="11" fill="{COLOURS[0]}"/>'
                     f'<text x="{left + 4 + n / top * (width - left - 50):.1f}" y="{y + 10}">{n}</text>')
    return svg(width, 8 + row * len(counts), parts)


# --- The page --------------------------------------------------------------------------------

def by_fault(results, name, title):
    found = merged(results, name)
    rows = [(key, of["n"], ms(quantile(of["values"], 0.5)), ms(quantile(of["values"], 0.95)), ms(of["max"]))
            for key, of in sorted(found.items())]
    return f"<h3>{escape(title)}</h3>" + table(("", "n", "median, ms", "95 %, ms", "most, ms"), rows) if rows else ""


def summary(results):
    """A row for each scenario, all of its instances together."""
    groups = {}
    for result in results:
        groups.setdefault(result["about"]["name"], []).append(result)
    rows = []
    for name, group in groups.items():
        counts = [sum(r["counts"].get(key, 0) for r in group)
                  for key in ("values judged", "setpoints judged", "puts")]
        state = ("WRONG" if any(r["failure"] for r in group) else
                 "right" if all(r["ended"] for r in group) else "stopped")
        rows.append((name, len(group), f"{sum(r['seconds'] for r in group) / 3600:.2f}",
                     sum(r["episodes"] for r in group), *counts, state))
    return table(("scenario", "instances", "hours", "episodes", "values judged", "setpoints judged", "puts", ""), rows)


def verdict(results):
    bad = [r for r in results if r["failure"]]
    hours = sum(r["seconds"] for r in results) / 3600
    if not bad:
        return (f'<p class="good"><b>Nothing lost, doubled, torn, stale or wrong</b> in {hours:.2f} hours of '
                f"{len(results)} scenarios.</p>")
    items = "".join(f"<li>{escape(r['about']['name'])}-{r['about']['instance']}, episode {r['episodes']}: "
                    f"{escape(r['failure'])}</li>" for r in bad)
    return f'<p class="bad"><b>Wrong:</b></p><ul class="bad">{items}</ul>'


def page(options, results, begun):
    """results: of each scenario; begun: one line of when and what was run."""
    faults = {}
    for result in results:
        for name, n in result["faults"].items():
            faults[name] = faults.get(name, 0) + n
    memory = {f"{r['about']['name']}-{r['about']['instance']}": [(s[0], s[1]) for s in r["series"]] for r in results}
    files = {f"{r['about']['name']}-{r['about']['instance']}": [(s[0], s[2]) for s in r["series"]] for r in results}
    gaps = {key: of["values"] for key, of in merged(results, "gap").items()}
    switches = [v for of in merged(results, "switch-over").values() for v in of["values"]]
    command = (f"make soak SEED={options.seed} DURATION={options.duration:g}s "
               f"TRANSPORTS={','.join(options.transports)} INSTANCES={options.instances}")
    plots = [figure("Gaps: inputs INVALID, by fault", strips(gaps) if gaps else "<p>none</p>"),
             figure("Episodes by fault", bars(faults)),
             figure("Switch-over of a pair: last block of the old PRIMARY until the new one led", histogram(switches))]
    plots += [figure(f"Put until the PLC has it: {key}", histogram(of["values"]))
              for key, of in sorted(merged(results, "put to PLC").items())]
    plots += [figure("Resident memory of each IOC", lines(memory, "MB", 1e6)),
              figure("Descriptors of each IOC", lines(files, "", 1))]
    return ("<!DOCTYPE html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>plclink: soak</title>"
            f"<style>{STYLE}</style></head><body><h1>plclink: soak, seed {options.seed}</h1>"
            f"{verdict(results)}<p>{escape(begun)}</p><p>Again: <code>{escape(command)}</code></p>{summary(results)}"
            f"{''.join(plots)}"
            + by_fault(results, "gap", "Inputs INVALID, episodes of one fault alone")
            + by_fault(results, "last block to INVALID", "From the last block to INVALID")
            + by_fault(results, "well again", "From the end of the fault until all is well")
            + by_fault(results, "switch-over", "Switch-over")
            + by_fault(results, "put to PLC", "Put until the PLC has it, faults included")
            + by_fault(results, "exit", "exit of an IOC")
            + by_fault(results, "machine late", "How late threads of the checker were at most, in the last 10 s")
            + "</body></html>\n")
