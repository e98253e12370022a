// The page of all results: sortable tables, charts whose points say what they are, replays that start when they are seen.
"use strict";
function page() {
  const number = text => { const found = /-?\d+(\.\d+)?(e-?\d+)?/.exec(text); return found ? +found[0] : NaN; };
  for (const head of document.querySelectorAll("table.sorts th"))
    head.onclick = () => {
      const table = head.closest("table"), column = [...head.parentNode.children].indexOf(head);
      const order = head.dataset.order === "1" ? -1 : 1;
      for (const other of head.parentNode.children) delete other.dataset.order;
      head.dataset.order = order;
      const rows = [...table.tBodies[0].rows];
      const key = row => row.cells[column].textContent;
      rows.sort((a, b) => {
        const [x, y] = [number(key(a)), number(key(b))];
        if (isNaN(x) || isNaN(y)) return order * key(a).localeCompare(key(b));
        return order * (x - y);
      });
      table.tBodies[0].append(...rows);
    };

  const colours = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9", "#787878", "#000", "#783c14"];
  const write = x => x >= 0.01 && x < 1e4 ? String(+x.toPrecision(3)) : x.toExponential(1);
  for (const element of document.querySelectorAll(".chart")) {
    const data = JSON.parse(element.querySelector("script").textContent);
    const points = data.points.filter(p => p.microseconds > 0 && p.error > 0 && p.error < 2 * data.hold);
    const width = 760, height = 460, left = 70, bottom = 46;
    const span = values => [Math.min(...values) / 1.6, Math.max(...values) * 1.6].map(Math.log10);
    const [x0, x1] = span(points.map(p => p.microseconds)), [y0, y1] = span([...points.map(p => p.error), data.hold]);
    const x = v => left + (Math.log10(v) - x0) / (x1 - x0) * (width - left - 16);
    const y = v => height - bottom - (Math.log10(v) - y0) / (y1 - y0) * (height - bottom - 12);
    let svg = "";
    const ticks = (a, b) => { const out = []; for (let k = Math.ceil(a); k <= b; k++) out.push(10 ** k); return out; };
    for (const t of ticks(x0, x1)) svg += `<path d="M${x(t)} 12V${height - bottom}" stroke="#e4e7ec"/><text x="${x(t)}" y="${height - bottom + 18}" text-anchor="middle">${write(t)}</text>`;
    for (const t of ticks(y0, y1)) svg += `<path d="M${left} ${y(t)}H${width - 16}" stroke="#e4e7ec"/><text x="${left - 8}" y="${y(t) + 4}" text-anchor="end">${write(t)}</text>`;
    svg += `<path d="M${left} ${y(data.hold)}H${width - 16}" stroke="#999" stroke-dasharray="6 5"/><text x="${left + 6}" y="${y(data.hold) - 5}" fill="#777">hold last</text>`;
    const names = [...new Set(points.map(p => p.series))];
    for (const [k, name] of names.entries()) {
      const own = points.filter(p => p.series === name), colour = colours[k % colours.length];
      svg += `<polyline fill="none" stroke="${colour}" stroke-opacity="0.5" points="${own.map(p => `${x(p.microseconds)},${y(p.error)}`).join(" ")}"/>`;
      for (const p of own) {
        const what = `${p.series}${p.substeps == null ? "" : ", " + p.substeps}: ${write(p.microseconds)} us a frame, ${write(p.error)} rad or m`;
        svg += `<circle cx="${x(p.microseconds)}" cy="${y(p.error)}" r="${p.front ? 6 : 4}" fill="${colour}"${p.front ? ' stroke="#000"' : ""}><title>${what}</title></circle>`;
      }
    }
    svg += `<text x="${(left + width) / 2}" y="${height - 6}" text-anchor="middle">microseconds a frame, one environment, one core</text>`;
    svg += `<text transform="translate(16 ${height / 2}) rotate(-90)" text-anchor="middle">mean |dq| (rad or m)</text>`;
    const keys = names.map((name, k) => `<span><i style="background:${colours[k % colours.length]}"></i>${name}</span>`).join("");
    element.innerHTML = `<svg viewBox="0 0 ${width} ${height}" font-size="12" font-family="sans-serif">${svg}</svg><div class="keys">${keys}</div>`;
  }

  // A replay is made when it comes into view.
  const begin = element => replay(element, JSON.parse(element.querySelector("script").textContent));
  const seen = new IntersectionObserver(entries => {
    for (const entry of entries.filter(e => e.isIntersecting)) {
      seen.unobserve(entry.target);
      begin(entry.target);
    }
  }, { rootMargin: "200px" });
  for (const element of document.querySelectorAll(".motion"))
    if (element.getBoundingClientRect().top < window.innerHeight) begin(element);
    else seen.observe(element);
}
