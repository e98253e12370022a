//! The live page in a real browser: display, drags and swaps agree with the solvers.

use std::sync::Arc;

use nerd_cli::live::{Act, Ask, Live, Shown, World};
use nerd_sim::prelude::*;
use nerd_train::evaluate::{Action, PassiveConfig, passive};
use nerd_train::spec::SolverSpec;
use serde_json::Value;

use crate::browser::Browser;

/// Seed of the start, which is `evaluate`'s first.
const SEED: u64 = 500;

fn ground() -> (Arc<System>, Arc<Scene>) {
    let system = System::named("ant").expect("built in");
    let scene = system.scene("ground").expect("its ground");
    (system, scene)
}

/// A limp Ant under the truth and two cheaper solvers.
fn ant() -> World {
    let (system, scene) = ground();
    let mut batch = Batch::new(&system, &scene, 1);
    batch.reset(0, &start(&system, Start::Reset, &mut stream(SEED, 0)));
    let simulation = Simulation::new(batch, Articulated::new(ArticulatedConfig::accurate(&system)));
    let settings = vec![SolverSpec::default(), SolverSpec::implicit(1), SolverSpec::rapier(4)];
    let mut world = World::new("ant", Act::Alone(simulation), settings).expect("a solver");
    world.answer(Ask::Hold(false));
    world
}

/// Steps once, by the page's own button, and waits for the picture.
fn step(browser: &mut Browser) {
    browser.run(
        "(async () => { const { frame } = await now(); by('step').click(); while ((await now()).frame === frame); })()",
    );
}

#[test]
fn the_page_shows_and_does_what_the_solvers_say() {
    let live = Live::serve(ant(), 0).expect("a port");
    let Some(mut browser) = Browser::open(&live.address(), [1200, 800]) else { return };
    browser.until("document.getElementById('seen')?.dataset.painted > 5");
    browser.run("by = id => document.getElementById(id); now = async () => (await fetch('/state')).json(); 0");
    // Records every request of the page from here on.
    browser.run("asked = []; own = fetch; fetch = (url, what) => { if (what) asked.push(what.body); return own(url, what); }; 0");

    // The page moves in real time.
    let pixels = "by('seen').getContext('2d').getImageData(0, 0, by('seen').width, by('seen').height).data.join()";
    browser.run(&format!("before = {pixels}; 0"));
    browser.run("by('reset').click()");
    browser.until(&format!("{pixels} !== before"));
    browser.run("by('ghost').click()");
    browser.until("by('figures').textContent.includes('apart')");
    let rate = "(async () => { const n = () => +by('seen').dataset.painted, first = n(), began = performance.now(); \
        await new Promise(done => setTimeout(done, 3000)); return (n() - first) / (performance.now() - began) * 1000; })()";
    let rate = browser.run(rate).as_f64().expect("a number");
    let cost = "(() => { const began = performance.now(); for (let k = 0; k < 20; k++) \
        { paint(); by('seen').getContext('2d').getImageData(0, 0, 1, 1); } return (performance.now() - began) / 20; })()";
    let cost = browser.run(cost).as_f64().expect("a number");
    println!(
        "an Ant, its truth and its ghost: {rate:.1} pictures a second, {cost:.1} ms each with all of its pixels, no card, on this machine as it is"
    );
    assert!(rate > 0.0, "it is not painted");

    // A drag by the mouse from the start moves the robot as the same drag in this test's world does.
    browser.run("by('pause').click()");
    browser.until("by('pause').textContent === 'Play'");
    browser.run("asked.length = 0; by('reset').click()");
    browser.until("by('figures').textContent.startsWith('frame 0,')");
    let middle = browser.run(
        "[by('seen').offsetLeft + by('seen').clientWidth / 2, by('seen').offsetTop + by('seen').clientHeight / 2]",
    );
    let [x, y] = [0, 1].map(|k| middle[k].as_f64().expect("a place"));
    browser.mouse("mousePressed", [x, y]);
    browser.mouse("mouseMoved", [x + 120.0, y - 80.0]);
    (0..20).for_each(|_| step(&mut browser));
    browser.mouse("mouseReleased", [x + 120.0, y - 80.0]);
    step(&mut browser);
    let before = browser.run("now()");
    // A swap in motion.
    browser.run("by('solver').value = 1; by('solver').onchange({ target: by('solver') })");
    browser.until("by('figures').textContent.includes('substeps=1')");
    let after = browser.run("now()");
    assert_eq!(before["tracks"], after["tracks"], "a swap moves the robot");
    step(&mut browser);

    let asked = browser.run("asked");
    let asks: Vec<Ask> = asked
        .as_array()
        .expect("asks")
        .iter()
        .map(|ask| Ask::read(ask.as_str().expect("a text")).expect("an ask"))
        .collect();
    assert!(asks.iter().any(|ask| matches!(ask, Ask::Drag(..))), "the mouse has hold of nothing: {asks:?}");
    let mut own = ant();
    own.answer(Ask::Ghost(true));
    let plain =
        |shown: Shown| serde_json::from_str::<Value>(&serde_json::to_string(&shown).expect("a frame")).expect("JSON");
    let still = plain(own.shown());
    asks.into_iter().for_each(|ask| own.answer(ask));
    let (shown, own) = (browser.run("now()"), plain(own.shown()));
    assert_eq!(shown["tracks"], own["tracks"], "the page is not where the same asks lead");
    let root = |shown: &Value| [0, 1, 2].map(|k| shown["tracks"][0][0][k].as_f64().expect("a place"));
    let moved = (Vector3::from(root(&own)) - Vector3::from(root(&still))).norm();
    assert!(moved > 0.05, "the drag moves it by {moved} m");

    // The ghost's distance over a rollout is `evaluate`'s.
    browser.run("by('reset').click()");
    browser.until("by('figures').textContent.startsWith('frame 0,')");
    let frames = 30;
    let apart = |browser: &mut Browser| {
        step(browser);
        browser.run("now()")["apart"].as_f64().expect("a distance")
    };
    let mean = (0..frames).map(|_| apart(&mut browser)).sum::<f64>() / frames as f64;
    let ((system, scene), config) =
        (ground(), PassiveConfig { starts: 1, steps: frames, seed: SEED, action: Action::Limp });
    let solver = |spec: SolverSpec| spec.solver(&system, 1).expect("a solver");
    let report = passive(
        &system,
        &scene,
        &mut *solver(SolverSpec::default()),
        &mut *solver(SolverSpec::implicit(1)),
        config,
        &mut |_| {},
    );
    let error = report.expect("a rollout").error;
    let error = error.iter().sum::<f64>() / error.len() as f64;
    println!("mean distance over {frames} frames: {mean:e} on the page, {error:e} by `evaluate`");
    assert!(error > 1e-6 && (mean - error).abs() < 1e-9 * error, "{mean} on the page, {error} by `evaluate`");
}
