//! The live page answers every visitor's requests, whatever other visitors send.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use nerd_cli::live::{Act, Ask, Live, MOST, Menu, World};
use nerd_sim::prelude::*;
use nerd_train::spec::SolverSpec;

/// A robot over its ground, held in its pose.
fn over_ground(robot: &str, settings: Vec<SolverSpec>) -> World {
    let system = System::named(robot).expect("built in");
    let mut batch = Batch::new(&system, &system.scene("ground").expect("its ground"), 1);
    batch.reset(0, &system.default_state());
    let simulation = Simulation::new(batch, Articulated::new(ArticulatedConfig::accurate(&system)));
    World::new("ant <in> ground", Act::Alone(simulation), settings).expect("a solver")
}

/// A limp Ant under the truth and two cheaper solvers.
fn ant() -> World {
    let mut world = over_ground("ant", vec![SolverSpec::default(), SolverSpec::implicit(1), SolverSpec::rapier(4)]);
    world.answer(Ask::Hold(false));
    world
}

/// The server, its address and its host.
fn served(world: World) -> (Live, String, String) {
    let live = Live::serve(world, 0).expect("a port");
    let address = live.address();
    let host = address.trim_start_matches("http://").to_string();
    (live, address, host)
}

/// The frame number in an answer.
fn frame(text: &str) -> Option<u64> {
    text.split("\"frame\":").nth(1)?.split(',').next()?.parse().ok()
}

/// Steps `n` times; returns the position of the robot's root.
fn steps(world: &mut World, n: usize) -> [f32; 3] {
    (0..n).for_each(|_| world.step());
    let shown = world.shown();
    assert!(shown.trouble.is_empty(), "{}", shown.trouble);
    std::array::from_fn(|k| shown.tracks[0][0][k])
}

#[test]
fn a_swap_keeps_the_state_and_the_ghost_goes_its_own_way() {
    let mut world = ant();
    let before = steps(&mut world, 20);
    world.answer(Ask::Ghost(true));
    world.answer(Ask::Solver(1));
    let after = steps(&mut world, 0);
    assert_eq!(before, after, "a swap moves the robot");
    assert_eq!(world.shown().apart, Some(0.0), "a ghost begins where the robot is");
    steps(&mut world, 30);
    // The page's own test compares the distance with `evaluate`.
    let apart = world.shown().apart.expect("a ghost");
    assert!(apart > 1e-6 && apart < 0.1, "the ghost is {apart} away");
}

#[test]
fn a_hand_lifts_the_robot_under_every_solver_and_gravity_brings_it_down() {
    let up = -System::named("ant").expect("built in").gravity().normalize();
    let height = |place: [f32; 3]| up.dot(&Vector3::from(place.map(f64::from)));
    for solver in 0..3 {
        let mut world = ant();
        world.answer(Ask::Solver(solver));
        let lies = steps(&mut world, 60);
        let target = Vector3::from(lies.map(f64::from)) + up;
        world.answer(Ask::Drag(0, [0.0; 3], target.into()));
        let held = height(steps(&mut world, 180));
        // A spring with 60 times the mass as stiffness gives by g / 60 = 0.164 m under the weight. It pulls once a
        // frame. The robot then rises at up to g dt before it sinks again, and the damper counts that as motion.
        let (sag, dt) = (1.0 - (held - height(lies)), 1.0 / 60.0);
        let law = 9.81 / 60.0;
        let most = law * (1.0 + (2.0 * 60f64.sqrt() + 60.0 * dt) * dt);
        assert!(
            (law - 0.005..most + 0.005).contains(&sag),
            "solver {solver}: it hangs {sag} m below the hand, by the laws {law} to {most}"
        );
        world.answer(Ask::Release);
        let down = height(steps(&mut world, 120));
        assert!(down < held - 0.5, "solver {solver}: released it is at {down}, held at {held}");
        world.answer(Ask::Gravity(0.0));
        world.answer(Ask::Reset);
        let first = height(steps(&mut world, 0));
        let still = height(steps(&mut world, 60));
        assert!(still >= first - 1e-3, "solver {solver}: without gravity it fell from {first} to {still}");
    }
}

#[test]
fn what_cannot_be_asked_is_refused_in_a_line() {
    for (text, of) in [
        ("", "EOF"),
        ("[]", "Ask"),
        (r#"{"do":"jump"}"#, "jump"),
        (r#"{"do":"gravity"}"#, "to"),
        (r#"{"do":"gravity","to":1e9}"#, "gravity"),
        (r#"{"do":"friction","to":-1}"#, "friction"),
        (r#"{"do":"drag","to":[0,[0,0,0],[0,0,1e9]]}"#, "drag"),
        (r#"{"do":"pause","to":true,"more":1}"#, "more"),
        (r#"{"do":"substeps","to":0}"#, "substeps"),
        (r#"{"do":"envs","to":1000000000}"#, "envs"),
        (r#"{"do":"robot","to":"/etc/passwd"}"#, "passwd"),
    ] {
        let error = Ask::read(text).expect_err(text);
        assert!(error.contains(of) && !error.contains('\n'), "`{text}`: {error}");
    }
    let mut world = ant();
    let drag = Ask::Drag(99, [0.0; 3], [0.0; 3]);
    for ask in [Ask::Solver(99), drag, Ask::Robot(99), Ask::Policy(99)] {
        world.answer(ask);
        world.step();
        assert!(world.shown().trouble.contains("99"), "a frame later: `{}`", world.shown().trouble);
        world.answer(Ask::Pause(false));
        steps(&mut world, 1);
    }
}

fn send(address: &str, text: &str) -> String {
    let mut stream = TcpStream::connect(address.trim_start_matches("http://")).expect("a connection");
    stream.set_read_timeout(Some(Duration::from_secs(2))).expect("a limit");
    // A server may hang up on nonsense before the last byte is written.
    let _ = stream.write_all(text.as_bytes());
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    String::from_utf8_lossy(&answer).into_owned()
}

fn post(address: &str, kind: &str, body: &str) -> String {
    let (host, length) = (address.trim_start_matches("http://"), body.len());
    send(
        address,
        &format!(
            "POST /ask HTTP/1.1\r\nHost: {host}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{body}"
        ),
    )
}

fn get(address: &str, path: &str, host: &str) -> String {
    send(address, &format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"))
}

#[test]
fn hostile_visitors_and_a_hundred_at_once_end_nothing() {
    let (_live, address, host) = served(ant());
    assert!(host.starts_with("127.0.0.1:"), "it listens at {host}");
    let page = get(&address, "/", &host);
    assert!(
        page.starts_with("HTTP/1.1 200") && page.contains("ant &lt;in&gt; ground") && page.contains("\"solvers\""),
        "{page:.300}"
    );
    for (answer, code) in [
        (get(&address, "/", "evil.example:80"), 403),
        (get(&address, "/state", "evil.example"), 403),
        (get(&address, "/etc/passwd", &host), 404),
        (post(&address, "text/plain", r#"{"do":"reset"}"#), 415),
        (post(&address, "application/json", "{"), 400),
        (post(&address, "application/json", &format!("\"{}\"", "x".repeat(100_000))), 413),
        (post(&address, "application/json", r#"{"do":"solver","to":1}"#), 200),
    ] {
        assert!(answer.starts_with(&format!("HTTP/1.1 {code}")), "for {code}: {answer:.200}");
    }
    for nonsense in ["", "\0\0\0\0", "GET / HTTP/9.9\r\n\r\n", "POST /ask HTTP/1.1\r\nContent-Length: -1\r\n\r\n"] {
        send(&address, nonsense);
    }
    // More unfinished bodies than there are threads.
    let begun: Vec<_> = (0..20)
        .map(|k| {
            let mut stream = TcpStream::connect(&host).expect("a connection");
            let length = if k % 2 == 0 { "Content-Length: 2000" } else { "Transfer-Encoding: chunked" };
            let text =
                format!("POST /ask HTTP/1.1\r\nHost: {host}\r\nContent-Type: application/json\r\n{length}\r\n\r\n");
            stream.write_all(text.as_bytes()).expect("begun");
            stream
        })
        .collect();
    // Clients that connect, ask and leave; clients that connect and say nothing.
    let mute: Vec<_> = (0..50).map(|_| TcpStream::connect(&host).expect("a connection")).collect();
    for _ in 0..50 {
        let mut stream = TcpStream::connect(&host).expect("a connection");
        stream.write_all(format!("GET / HTTP/1.1\r\nHost: {host}\r\n\r\n").as_bytes()).expect("asked");
    }
    let before = frame(&get(&address, "/state", &host)).expect("a frame");
    let began = Instant::now();
    let seen: Vec<_> = std::thread::scope(|scope| {
        let visitors: Vec<_> = (0..100).map(|_| scope.spawn(|| get(&address, "/state", &host))).collect();
        visitors.into_iter().map(|visitor| visitor.join().expect("no panic")).collect()
    });
    assert!(seen.iter().all(|text| frame(text).is_some()), "somebody of a hundred got no frame");
    std::thread::sleep(Duration::from_millis(100).saturating_sub(began.elapsed()));
    let after = get(&address, "/state", &host);
    assert!(frame(&after) > Some(before) && after.contains("\"solver\":1"), "from frame {before} on: {after:.300}");
    drop((mute, begun));
}

#[test]
fn a_flood_of_asks_does_not_stop_the_motion() {
    let (_live, address, host) = served(ant());
    let now = || frame(&get(&address, "/state", &host));
    let before = now().expect("a frame");
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                (0..100).for_each(|_| drop(post(&address, "application/json", r#"{"do":"hold","to":true}"#)))
            });
        }
    });
    let after = now().expect("a frame");
    assert!(after > before, "400 asks later it is still frame {after}");
}

#[test]
fn a_world_slower_than_time_still_hears() {
    let system = System::named("ant").expect("built in");
    let batch = Batch::new(&system, &system.scene("ground").expect("its ground"), 1024);
    let simulation = Simulation::new(batch, Articulated::new(ArticulatedConfig::accurate(&system)));
    let (_live, address, host) =
        served(World::new("many", Act::Alone(simulation), vec![SolverSpec::implicit(64)]).expect("a solver"));
    post(&address, "application/json", r#"{"do":"pause","to":true}"#);
    let began = Instant::now();
    while !get(&address, "/state", &host).contains("\"paused\":true") {
        assert!(began.elapsed() < Duration::from_secs(60), "a minute later it has not paused");
    }
}

#[test]
fn a_friction_that_was_changed_keeps_no_model_away() {
    let model = nerd_train::shipped::model(Truth::Articulated, "ant");
    let mut world =
        if model.exists() { over_ground("ant", vec![SolverSpec::default(), SolverSpec::neural(model)]) } else { ant() };
    world.answer(Ask::Friction(0.1));
    world.answer(Ask::Solver(1));
    steps(&mut world, 5);
    world.answer(Ask::Friction(0.3));
    steps(&mut world, 5);
}

/// A leg's end link has about a hundredth of the robot's mass. An explicit hand as strong as the weight would throw it.
#[test]
fn a_hand_at_a_toe_is_stable() {
    let mut world = over_ground("anymal", vec![SolverSpec::default()]);
    let system = world.system.clone();
    let toe = system.robot.contact_points.last().expect("feet").clone();
    world.answer(Ask::Ghost(true));
    let up = -system.gravity().normalize();
    let target = Vector3::from(steps(&mut world, 30).map(f64::from)) + up;
    world.answer(Ask::Drag(toe.link, toe.local.into(), target.into()));
    steps(&mut world, 240);
    let root = steps(&mut world, 1);
    assert!(root.iter().all(|x| x.abs() < 5.0), "the root is at {root:?} after four seconds");
    let apart = world.shown().apart.expect("a ghost");
    assert!(apart < 1e-9, "the truth and its ghost, pulled alike, are {apart} apart");
}

#[test]
fn substeps_are_those_of_the_solver_that_moves() {
    let mut world = ant();
    world.answer(Ask::Solver(1));
    world.answer(Ask::Substeps(8));
    let shown = world.shown();
    assert_eq!((shown.name.as_str(), shown.substeps), ("articulated(substeps=8)", Some(8)));
    let by_hand = steps(&mut over_ground_limp(8), 40);
    assert_eq!(steps(&mut world, 40), by_hand, "eight substeps move as eight");
    assert_ne!(by_hand, steps(&mut over_ground_limp(1), 40), "and one otherwise");
    for solver in [2, 0] {
        world.answer(Ask::Solver(solver));
        world.answer(Ask::Substeps(2));
        assert_eq!(world.shown().trouble.is_empty(), solver == 2, "solver {solver}: {}", world.shown().trouble);
    }
}

fn over_ground_limp(substeps: usize) -> World {
    let mut world = over_ground("ant", vec![SolverSpec::implicit(substeps)]);
    world.answer(Ask::Hold(false));
    world
}

#[test]
fn a_menu_leads_from_robot_to_policy_to_a_thousand() {
    let mut world = World::of(Menu::new(Some("cartpole"), None, None, &[]).expect("built in")).expect("a world");
    let page = world.page();
    let place = |list: &str, name: &str| {
        let all = page["menu"][list].as_array().expect("a list").clone();
        all.iter()
            .position(|own| own.as_str().is_some_and(|own| own.ends_with(name)))
            .unwrap_or_else(|| panic!("no {name} in {list}"))
    };
    world.answer(Ask::Robot(place("robots", "pendulum")));
    assert!(world.title.starts_with("pendulum in "), "{}", world.title);
    if !nerd_train::shipped::policies("").expect("a folder").is_empty() {
        world.answer(Ask::Policy(1 + place("policies", "ant-run-neural-200")));
        assert_eq!((world.title.as_str(), world.shown().trouble.as_str()), ("ant-run", ""));
        steps(&mut world, 3);
        world.answer(Ask::Policy(0));
    }
    assert_eq!(world.shown().tracks.len(), 1);
    let numbers = world.number;
    world.answer(Ask::Envs(1000));
    world.page();
    let lines = |world: &World| {
        world.crowd().chunks_exact(4).map(|x| f32::from_le_bytes([x[0], x[1], x[2], x[3]])).collect::<Vec<_>>()
    };
    let before = lines(&world);
    let each = before.len() / 999;
    assert!(each > 0 && each % 6 == 0 && before.len() == 999 * each, "{} numbers for 999 robots", before.len());
    steps(&mut world, 5);
    let after = lines(&world);
    let still = before.chunks_exact(each).zip(after.chunks_exact(each)).filter(|(a, b)| a == b).count();
    assert!(still == 0 && after.iter().all(|x| x.is_finite()), "{still} of 999 do not move");
    assert_eq!(world.number, numbers + 1);
    world.answer(Ask::Envs(MOST));
    world.answer(Ask::Ghost(true));
    steps(&mut world, 1);
    assert_eq!(world.shown().apart, Some(0.0), "the first of {MOST} under the truth is where its ghost is");
}

/// As many connections as a process may open, silent ones and ones that send half a request. A visitor is answered
/// among them and after them.
#[test]
fn a_page_answers_beside_more_connections_than_it_bears() {
    let (_live, address, host) = served(ant());
    let mut all = Vec::new();
    for k in 0..1500 {
        // This process has the same limit on connections.
        let Ok(mut stream) = TcpStream::connect(&host) else { break };
        if k % 3 == 0 {
            let _ = stream.write_all(b"POST /ask HTTP/1.1\r\nHost: ");
        }
        all.push(stream);
        if k % 250 == 0 {
            assert!(frame(&get(&address, "/state", &host)).is_some(), "beside {k} connections nobody is answered");
        }
    }
    // Room for this test's own connections.
    all.truncate(all.len() - 10);
    let ask = || frame(&get(&address, "/state", &host));
    let begun = Instant::now();
    while ask().is_none() {
        assert!(begun.elapsed() < Duration::from_secs(10), "beside {} connections nobody is answered", all.len());
    }
    let n = all.len();
    drop(all);
    assert!(n > 400 && ask().is_some(), "after {n} connections nobody is answered");
}

#[test]
fn a_request_that_does_not_come_to_its_end_is_hung_up_on() {
    let (_live, _, host) = served(ant());
    let mut stream = TcpStream::connect(&host).expect("a connection");
    let began = Instant::now();
    stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a limit");
    // A letter a second keeps nothing open.
    let mut answer = [0; 16];
    let end = (0..30).find_map(|_| {
        let _ = stream.write_all(b"G");
        stream.set_read_timeout(Some(Duration::from_millis(500))).expect("a limit");
        match stream.read(&mut answer) {
            Err(e) if matches!(e.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) => None,
            _ => Some(began.elapsed()),
        }
    });
    let end = end.expect("it is still open").as_secs_f64();
    assert!((4.0..9.0).contains(&end), "it was hung up on after {end:.1} s, 5 s are borne");
}

#[test]
fn a_host_is_known_with_its_port_and_without() {
    let (_live, address, host) = served(ant());
    for (name, code) in [
        (host.as_str(), 200),
        ("127.0.0.1", 200),
        ("localhost", 200),
        ("localhost:80", 200),
        ("127.0.0.1.evil.example", 403),
        ("", 403),
    ] {
        let answer = get(&address, "/state", name);
        assert!(answer.starts_with(&format!("HTTP/1.1 {code}")), "host `{name}`: {answer:.60}");
    }
}
