// The page of `cargo xtask live`: fetches and paints the latest frame, and sends the visitor's inputs as requests.
function live({ robot, sticks, solvers, menu, number, friction, gravity }) {
  const by = id => document.getElementById(id), seen = by("seen"), drawn = by("drawn");
  // Sends requests one at a time, so that they arrive in order.
  let asks = Promise.resolve();
  const post = what => fetch("/ask", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(what) })
    .then(async answer => { by("refused").textContent = answer.ok ? "" : await answer.text(); }).catch(() => {});
  const ask = what => asks = asks.then(() => post(what));
  const list = (id, names, chosen) => {
    names.forEach(([name, value]) => by(id).add(new Option(name, value)));
    by(id).value = chosen;
    by(id).parentElement.hidden = names.length < 2;
  };
  const last = path => path.split("/").pop();
  list("solver", solvers.map((name, k) => [name, k]), 0);
  list("robot", menu.robots.map((name, k) => [last(name), k]), menu.robot);
  list("scene", menu.scenes.map((name, k) => [name, k]), menu.scene);
  list("policy", [["none", 0], ...menu.policies.map((path, k) => [last(path), k + 1])], menu.policy);
  list("envs", [...new Set([menu.envs, ...(menu.robots.length ? [1, 64, 1024, 4096] : [])])].map(n => [n, n]), menu.envs);
  [by("friction").value, by("gravity").value] = [friction, gravity];
  let painter = null, state = null, text = "", others = null, grip = null, moments = [], painting = 0, changed = false;
  const past = [];

  const size = canvas => {
    const scale = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth * scale, canvas.clientHeight * scale].map(Math.round);
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    return scale;
  };

  // Plots the ghost's distance and both solvers' times over the last frames; the times share one scale.
  function figures() {
    const context = drawn.getContext("2d"), scale = size(drawn);
    context.clearRect(0, 0, drawn.width, drawn.height);
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
    by("figures").textContent = `frame ${state.frame}, ${state.name} ${state.cost[0].toFixed(0)} us${ghost}; ` +
      `${moments.length} pictures a second, each painted in ${painting.toFixed(1)} ms`;
    by("trouble").textContent = state.trouble;
    by("pause").textContent = state.paused ? "Play" : "Pause";
    by("solver").value = state.solver;
    by("substeps").parentElement.hidden = state.substeps === null;
    if (document.activeElement !== by("substeps")) by("substeps").value = state.substeps || 1;
    [by("ghost").checked, by("hold").checked] = [state.apart !== null, state.hold];
  }

  function paint() {
    const scale = size(seen);
    robot.tracks = state.tracks.map((poses, k) => ({ name: k ? "truth" : "robot", poses: [poses] }));
    if (!painter) {
      painter = replay.painter(robot);
      painter.view.distance *= 0.75 * Math.sqrt(menu.envs) + 0.25;
      if (menu.envs > 1) painter.view.lift = 0.6;
    }
    painter.paint(seen, 0, painter.view, scale, others && { sticks, ends: others });
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

  async function read() {
    const now = await (await fetch("/state")).text(), answer = now === text ? state : JSON.parse(now);
    if (answer === state) return;
    if (answer.number !== number) return location.reload();
    if (menu.envs > 1) others = new Float32Array(await (await fetch("/crowd")).arrayBuffer());
    if (answer.frame !== state?.frame) past.push(answer);
    if (past.length > 300) past.shift();
    [state, text, changed] = [answer, now, true];
  }

  // Frames are fetched beside the painting, one at a time.
  let reading = false, told = 0;
  function look(now) {
    requestAnimationFrame(look);
    if (!reading) {
      reading = true;
      read().catch(error => { by("trouble").textContent = `no answer: ${error.message}`; }).finally(() => { reading = false; });
    }
    if (!changed) return;
    changed = false;
    const began = performance.now();
    paint();
    // Updates plots and numbers every 0.1 s at most while the motion runs.
    if (state.paused || now - told > 100) {
      figures();
      told = now;
    }
    painting += 0.1 * (performance.now() - began - painting);
    moments = [...moments.filter(moment => moment > now - 1000), now];
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
  const drag = () => ask({ do: "drag", to: [grip.link, grip.local, grip.target] });
  seen.onpointerdown = e => {
    seen.setPointerCapture(e.pointerId);
    grip = state && painter && !e.shiftKey ? find(pointer(e)) : null;
    if (grip) drag();
  };
  seen.onpointermove = e => {
    if (grip) {
      const { focus, right, above, eye, back } = painter.camera(seen, 0, painter.view), [x, y] = pointer(e);
      const a = (x - seen.width / 2) * grip.depth / focus, b = (seen.height / 2 - y) * grip.depth / focus;
      grip.target = [0, 1, 2].map(k => eye[k] - back[k] * grip.depth + right[k] * a + above[k] * b);
      drag();
    } else if (painter && e.buttons) {
      painter.turn(e);
    }
    changed = state !== null;
  };
  seen.onpointerup = seen.onpointercancel = () => {
    if (grip) ask({ do: "release" });
    grip = null;
  };
  seen.onwheel = e => { e.preventDefault(); if (painter) painter.view.distance *= Math.exp(e.deltaY * 0.001); changed = state !== null; };
  window.addEventListener("resize", () => { changed = state !== null; });
  by("pause").onclick = () => ask({ do: "pause", to: !state.paused });
  by("step").onclick = () => ask({ do: "pause", to: true }).then(() => ask({ do: "step" }));
  by("reset").onclick = () => ask({ do: "reset" });
  for (const id of ["ghost", "hold"]) by(id).onchange = e => ask({ do: id, to: e.target.checked });
  for (const id of ["robot", "scene", "policy", "envs", "solver", "substeps", "friction", "gravity"])
    by(id).onchange = e => ask({ do: id, to: +e.target.value });
  look(performance.now());
  return paint;
}
