// The page of `cargo xtask live`: asks for the latest frame, paints it with the painter of replays, and says what the visitor does.
function live({ robot, solvers, friction, gravity }) {
  const by = id => document.getElementById(id), seen = by("seen"), drawn = by("drawn");
  const ask = what => fetch("/ask", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(what) })
    .then(async answer => { by("refused").textContent = answer.ok ? "" : await answer.text(); }).catch(() => {});
  solvers.forEach((name, k) => by("solver").add(new Option(name, k)));
  [by("friction").value, by("gravity").value] = [friction, gravity];
  let painter = null, state = null, grip = null, turning = null;
  const past = [];

  const size = canvas => {
    const scale = window.devicePixelRatio || 1;
    canvas.width = canvas.clientWidth * scale;
    canvas.height = canvas.clientHeight * scale;
    return scale;
  };

  // Distance of the ghost (filled) and microseconds of both, over the last frames, each from 0 to its own largest.
  function figures() {
    const context = drawn.getContext("2d"), scale = size(drawn);
    const rows = [["distance", "#b8450f", p => p.apart || 0], ["solver's time", "#2b6cb0", p => p.cost[0]], ["ghost's time", "#8a94a3", p => p.cost[1]]];
    rows.forEach(([name, colour, of], row) => {
      context.fillStyle = colour;
      context.font = `${11 * scale}px sans-serif`;
      context.fillText(name, 8 * scale, (14 + 14 * row) * scale);
      const most = Math.max(1e-9, ...past.map(of), ...(row ? past.map(p => Math.max(...p.cost)) : []));
      context.strokeStyle = colour;
      context.lineWidth = 1.5 * scale;
      context.beginPath();
      past.forEach((p, k) => context.lineTo(drawn.width * k / 300, drawn.height * (0.95 - 0.85 * of(p) / most)));
      context.stroke();
    });
    const ghost = state.apart === null ? "" : `, ghost ${state.cost[1].toFixed(0)} us, ${state.apart.toExponential(2)} apart`;
    by("figures").textContent = `frame ${state.frame}, ${solvers[state.solver]} ${state.cost[0].toFixed(0)} us${ghost}`;
    by("trouble").textContent = state.trouble;
    by("pause").textContent = state.paused ? "Play" : "Pause";
    by("solver").value = state.solver;
    [by("ghost").checked, by("hold").checked] = [state.apart !== null, state.hold];
  }

  function paint() {
    const scale = size(seen);
    robot.tracks = state.tracks.map((poses, k) => ({ name: k ? "truth" : "robot", poses: [poses] }));
    painter = painter || replay.painter(robot);
    painter.paint(seen, 0, painter.view, scale);
    if (grip) {
      const camera = painter.camera(seen, 0, painter.view), context = seen.getContext("2d");
      context.strokeStyle = "#d0021b";
      context.lineWidth = 2 * scale;
      context.beginPath();
      [painter.place(state.tracks[0][grip.link], grip.local), grip.target].map(camera.see).forEach(p => context.lineTo(p[0], p[1]));
      context.stroke();
    }
    seen.dataset.painted = +(seen.dataset.painted || 0) + 1;
  }

  async function look() {
    try {
      const answer = await (await fetch("/state")).json();
      if (!state || answer.frame !== state.frame) {
        past.push(answer);
        if (past.length > 300) past.shift();
      }
      state = answer;
      paint();
      figures();
    } catch (error) {
      by("trouble").textContent = `no answer: ${error.message}`;
    }
    requestAnimationFrame(look);
  }

  // What is under the pointer: the solid whose middle is nearest, if it is near.
  const pointer = e => { const scale = window.devicePixelRatio || 1; return [e.offsetX * scale, e.offsetY * scale]; };
  function find([x, y]) {
    const camera = painter.camera(seen, 0, painter.view), scale = window.devicePixelRatio || 1;
    let best = null, least = 40 * scale;
    for (const { link, pose } of robot.shapes.filter(shape => shape.link !== null)) {
      const at = painter.place(state.tracks[0][link], pose.slice(0, 3)), [u, v, depth] = camera.see(at), gap = Math.hypot(u - x, v - y);
      if (depth > 0 && gap < least) [best, least] = [{ link, local: pose.slice(0, 3), target: at, depth }, gap];
    }
    return best;
  }
  const drag = () => ask({ do: "drag", link: grip.link, local: grip.local, target: grip.target });
  seen.onpointerdown = e => {
    seen.setPointerCapture(e.pointerId);
    grip = state && painter && !e.shiftKey ? find(pointer(e)) : null;
    if (grip) drag(); else turning = [e.clientX, e.clientY];
  };
  seen.onpointermove = e => {
    if (grip) {
      const { focus, right, above, eye, back } = painter.camera(seen, 0, painter.view), [x, y] = pointer(e);
      const a = (x - seen.width / 2) * grip.depth / focus, b = (seen.height / 2 - y) * grip.depth / focus;
      grip.target = [0, 1, 2].map(k => eye[k] - back[k] * grip.depth + right[k] * a + above[k] * b);
      drag();
    } else if (turning) {
      painter.view.turn += (turning[0] - e.clientX) * 0.008;
      painter.view.lift = Math.min(1.5, Math.max(-0.2, painter.view.lift + (e.clientY - turning[1]) * 0.006));
      turning = [e.clientX, e.clientY];
    }
  };
  seen.onpointerup = seen.onpointercancel = () => {
    if (grip) ask({ do: "release" });
    grip = turning = null;
  };
  seen.onwheel = e => { e.preventDefault(); if (painter) painter.view.distance *= Math.exp(e.deltaY * 0.001); };
  by("pause").onclick = () => ask({ do: "pause", to: !state.paused });
  by("step").onclick = () => ask({ do: "pause", to: true }).then(() => ask({ do: "step" }));
  by("reset").onclick = () => ask({ do: "reset" });
  by("solver").onchange = e => ask({ do: "solver", to: +e.target.value });
  for (const id of ["ghost", "hold"]) by(id).onchange = e => ask({ do: id, to: e.target.checked });
  for (const id of ["friction", "gravity"]) by(id).onchange = e => ask({ do: id, to: +e.target.value });
  look();
}
