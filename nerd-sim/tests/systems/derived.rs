//! Settings derived from a URDF alone: base, contact that scales with the robot, starts within limits and above the
//! ground. A TOML may set a part of them.

use super::common::*;

/// A block of this mass (kg) and size (m), centred at `place` in its link.
fn block(name: &str, mass: f64, [x, y, z]: [f64; 3], place: [f64; 3]) -> String {
    let inertia = |a: f64, b: f64| mass * (a * a + b * b) / 12.0;
    link(
        name,
        mass,
        place,
        [inertia(y, z), inertia(x, z), inertia(x, y)],
        &collision(place, &format!("<box size=\"{x} {y} {z}\"/>")),
    )
}

fn hinge(name: &str, links: [&str; 2], [x, y, z]: [f64; 3], effort: f64) -> String {
    let limit = format!("<limit lower=\"-1\" upper=\"0.8\" effort=\"{effort}\" velocity=\"10\"/>");
    joint(name, "revolute", links, &format!("<origin xyz=\"{x} {y} {z}\"/><axis xyz=\"0 1 0\"/>{limit}"))
}

/// The trunk of a table on four legs, all lengths times `scale`.
fn trunk(scale: f64) -> String {
    block("trunk", 6.0 * scale.powi(3), [0.6 * scale, 0.3 * scale, 0.1 * scale], [0.0; 3])
}

/// A table on four hinged legs; `foot` is appended to each leg's link.
fn table(scale: f64, foot: &str) -> String {
    let (s, mass) = (|x: f64| x * scale, |m: f64| m * scale.powi(3));
    let mut parts = vec![trunk(scale)];
    for (k, [x, y]) in [[0.3, 0.15], [0.3, -0.15], [-0.3, 0.15], [-0.3, -0.15]].into_iter().enumerate() {
        let leg = format!("leg{k}");
        let own = block(&leg, mass(1.0), [s(0.04), s(0.04), s(0.3)], [0.0, 0.0, s(-0.15)]);
        parts.push(own.replace("</link>", &format!("{foot}</link>")));
        parts.push(hinge(&format!("hip{k}"), ["trunk", &leg], [s(x), s(y), 0.0], mass(20.0) * scale));
    }
    urdf(&parts)
}

/// A chain of links on a pedestal.
fn arm() -> String {
    let mut parts = vec![block("link0", 20.0, [0.2; 3], [0.0, 0.0, 0.1])];
    for k in 1..4 {
        let [above, own] = [k - 1, k].map(|k| format!("link{k}"));
        parts.push(block(&own, 2.0, [0.06, 0.06, 0.3], [0.0, 0.0, 0.15]));
        parts.push(hinge(&format!("joint{k}"), [&above, &own], [0.0, 0.0, if k == 1 { 0.2 } else { 0.3 }], 50.0));
    }
    urdf(&parts)
}

fn read(urdf: &str, toml: Option<&str>) -> Result<Arc<System>, SystemError> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("robot.urdf");
    std::fs::write(&path, urdf).expect("written");
    if let Some(text) = toml {
        std::fs::write(path.with_extension("toml"), text).expect("written");
    }
    System::named(&path.to_string_lossy())
}

#[test]
fn what_walks_is_free_and_what_is_an_arm_is_not() {
    let brick = urdf(&[block("brick", 1.0, [0.1; 3], [0.0; 3])]);
    for (name, urdf, free) in [("table", table(1.0, ""), true), ("arm", arm(), false), ("brick", brick, true)] {
        let system = read(&urdf, None).expect("a robot");
        assert_eq!(system.robot.floating(), free, "{name}");
        assert!(
            system.notes.iter().any(|n| n.contains(if free { "free base" } else { "fixed base" })),
            "{:?}",
            system.notes
        );
        match read(&urdf, Some(&format!("like = \"urdf\"\nfloating = {}", !free))) {
            Ok(other) => assert_eq!(other.robot.floating(), !free, "{name}: one line says otherwise"),
            Err(e) => assert!(name == "brick" && e.to_string().contains("moves"), "{name}: {e}"),
        }
    }
}

#[test]
fn a_part_of_a_toml_overrides_what_the_urdf_suggests() {
    let text = "like = \"urdf\"\nframe_time = \"1/100\"\nmaterial.friction = 0.9\n[[joint]]\nname = \"hip1\"\narmature = 0.03\n";
    let [system, plain] = [Some(text), None].map(|toml| read(&table(1.0, ""), toml).expect("a robot"));
    assert_eq!(system.frame_time, 0.01);
    let armatures: Vec<f64> = system.robot.joints().map(|j| j.armature).collect();
    assert_eq!(armatures, [0.0, 0.03, 0.0, 0.0], "no drive inertia that the file does not give");
    assert_eq!(
        system.joint_specs().nth(1).map(|j| j.kp),
        plain.joint_specs().nth(1).map(|j| j.kp),
        "the rest of the joint is what it was"
    );
    let [own, derived] = [&system, &plain].map(|system| system.spec.material);
    assert_eq!(own, Material { friction: 0.9, ..derived }, "the rest of the material, too");
    for (key, words) in [
        ("default_q = -90", ["default_q is -90", "in rad"]),
        ("kp = \"30 N\"", ["[[joint]] name = \"hip1\": ", "30 N"]),
    ] {
        let said = read(&table(1.0, ""), Some(&text.replace("armature = 0.03", key))).err().map(|e| e.to_string());
        assert!(said.as_ref().is_some_and(|said| words.iter().all(|word| said.contains(word))), "{said:?}");
    }
}

/// A point mass on its own axis has no rotational inertia: only this joint gets armature, and a note.
#[test]
fn a_joint_that_no_link_resists_has_a_guessed_armature_and_a_note() {
    let tip =
        [link("tip", 0.1, [0.0; 3], [0.0; 3], ""), hinge("spin", ["link3", "tip"], [0.0, 0.0, 0.3], 50.0)].concat();
    let system = read(&arm().replace("</robot>", &(tip + "</robot>")), None).expect("a robot");
    let armatures: Vec<f64> = system.robot.joints().map(|j| j.armature).collect();
    // 50 N m accelerate it to 10 rad/s in 10 ms.
    assert_eq!(armatures, [0.0, 0.0, 0.0, 0.05]);
    assert!(
        system.notes.iter().any(|n| n.contains("guessed armature") && n.contains("spin 0.05")),
        "{:?}",
        system.notes
    );
}

/// The printed specification gives the same robot if placed beside the file.
#[test]
fn the_printed_specification_is_the_robot() {
    for urdf in [table(1.0, ""), arm()] {
        let system = read(&urdf, None).expect("a robot");
        let again =
            read(&urdf, Some(&format!("like = \"urdf\"\n{}", system.spec_text()))).expect("it was printed by us");
        assert_eq!(again.sha256(), system.sha256(), "{}", system.spec_text());
    }
}

/// Tables from a toy's size to a house's rest at a penetration of a thousandth of the size. Starts are clear of the
/// ground.
#[test]
fn contact_scales_with_the_robot() {
    for scale in [0.1, 1.0, 10.0] {
        let system = read(&table(scale, ""), None).expect("a robot");
        let mut batch = at(&system, "plane", &system.default_state());
        batch.drives = nerd_sim::drive::specified(&system);
        let scene = batch.scenes[0].clone();
        let last = end(&mut Articulated::new(ArticulatedConfig::accurate(&system)), batch, 0.0, 120);
        let give = (system.default_state()[2] - last[2]) / (0.6 * scale);
        assert!((2e-4..3e-3).contains(&give), "scale {scale}: pressed in by {give} of its length");
        assert!(last[6].abs() > 0.999, "scale {scale}: it fell over: {:?}", &last[3..7]);
        let (mut data, mut events) = (Data::new(&system.robot), Vec::new());
        for k in 0..50 {
            let state = start(&system, if k % 2 == 0 { Start::Sample } else { Start::Reset }, &mut stream(1, k));
            contacts(&system, &scene, &state, &mut data, &mut events);
            assert!(
                events.iter().zip(&system.robot.contact_points).all(|(e, p)| e.distance > p.radius),
                "a start within the ground"
            );
            assert!(
                state[7..11].iter().all(|q| (-1.0..=0.8).contains(q)),
                "a start beyond the limits: {:?}",
                &state[7..11]
            );
        }
    }
}

/// A robot keeps the contact points on which it rests: balls at the ends of legs. Its default height makes them touch.
#[test]
fn what_stands_keeps_its_feet() {
    let system = read(&table(1.0, &collision([0.0, 0.0, -0.3], "<sphere radius=\"0.04\"/>")), None).expect("a robot");
    for link in 1..5 {
        let feet = system.robot.contact_points.iter().filter(|p| p.link == link && p.radius == 0.04).count();
        assert_eq!(feet, 1, "link {link} of {:?}", system.robot.contact_points);
    }
    assert!((system.default_state()[2] - 0.34).abs() < 1e-6, "stands at {} m", system.default_state()[2]);
}

/// Gaps are distances from ball centres less radii. Here centres of small feet are nearer to the ground than a belly's
/// radius.
#[test]
fn small_feet_beside_a_large_belly_start_clear_of_the_ground() {
    let [foot, belly] =
        [([0.0, 0.0, -0.3], 0.02), ([0.0; 3], 0.28)].map(|(at, r)| collision(at, &format!("<sphere radius=\"{r}\"/>")));
    let text = table(1.0, &foot).replacen("</link>", &format!("{belly}</link>"), 1);
    let system = read(&text, None).expect("a robot with starts");
    let (ground, mut data, mut events) = (system.scene("plane").expect("a plane"), system.data(), Vec::new());
    for k in 0..50 {
        let state = start(&system, Start::Reset, &mut stream(1, k));
        contacts(&system, &ground, &state, &mut data, &mut events);
        let gaps = events.iter().zip(&system.robot.contact_points).map(|(event, point)| event.distance - point.radius);
        let low = gaps.fold(f64::INFINITY, f64::min);
        assert!((0.0..0.4).contains(&low), "start {k}: {low} m over the ground");
    }
}

/// A lone cylinder, from a coin to a column, is a robot that stands on its end.
#[test]
fn a_cylinder_alone_is_a_robot() {
    for length in [0.005, 0.1, 0.12, 0.15, 1.0] {
        let shape = collision([0.0; 3], &format!("<cylinder radius=\"0.05\" length=\"{length}\"/>"));
        let system =
            read(&urdf(&[link("can", 0.3, [0.0; 3], [5.5e-4, 5.5e-4, 3.75e-4], &shape)]), None).expect("a can");
        assert!((system.default_state()[2] - 0.5 * length).abs() < 1e-4, "stands at {} m", system.default_state()[2]);
    }
}

/// An arm falls onto the table that is its root link. The tool's lowest corner rests on the table, on either side.
#[test]
fn the_tool_of_an_arm_rests_on_the_table_that_it_is_mounted_on() {
    let mut parts = vec![block("table", 20.0, [1.6, 1.6, 0.05], [0.0, 0.0, -0.025])];
    for (k, size) in [[0.12, 0.12, 0.1], [0.06, 0.06, 0.4], [0.06, 0.06, 0.3], [0.2, 0.04, 0.1]].into_iter().enumerate()
    {
        let [above, own] = [k, k + 1].map(|k| if k == 0 { "table".into() } else { format!("link{k}") });
        parts.push(block(&own, 1.0, size, [0.0, 0.0, 0.5 * size[2]]));
        let place = [0.0, 0.0, [0.0, 0.1, 0.4, 0.3][k]];
        let axis = if k == 0 { "0 0 1" } else { "0 1 0" };
        parts.push(
            hinge(&format!("joint{k}"), [&above, &own], place, 50.0)
                .replace("0 1 0", axis)
                .replace("-1\" upper=\"0.8", "-2\" upper=\"2"),
        );
    }
    let system = read(&urdf(&parts), None).expect("an arm");
    assert!(system.notes.iter().any(|n| n.contains("base are part of every scene")), "{:?}", system.notes);
    let mut data = Data::new(&system.robot);
    for (turn, lean) in [(0.3, 0.5), (-1.0, -0.4)] {
        let mut state = system.default_state();
        (state[0], state[1], state[3]) = (turn, lean, lean);
        let mut batch = at(&system, "base", &state);
        batch.drives = nerd_sim::drive::holding(&system, &state);
        batch.drives.iter_mut().for_each(|drive| (drive.kp, drive.kd) = (0.0, 2.0));
        let last = end(&mut Articulated::new(ArticulatedConfig::accurate(&system)), batch, 0.0, 600);
        kinematics(&system.robot, &last, &mut data);
        let corners = (0..8).map(|c| Vector3::new([-0.1, 0.1][c & 1], [-0.02, 0.02][c >> 1 & 1], [0.0, 0.1][c >> 2]));
        let lowest = corners.map(|corner| point_position(&data, 3, &corner).z).fold(f64::MAX, f64::min);
        assert!(lowest.abs() < 1e-3, "leaning by {lean} rad: the tool is {lowest} m over the table");
    }
}

/// Reading time is linear in the number of spheres, not cubic.
#[test]
fn two_thousand_spheres_on_a_link_are_read_in_seconds() {
    let spheres = |n: usize| {
        (0..n).map(|k| collision([0.0, 0.0, 0.001 * k as f64], r#"<sphere radius="0.1"/>"#)).collect::<String>()
    };
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("spheres.urdf");
    std::fs::write(&path, urdf(&[link("body", 1.0, [0.0; 3], [1.0; 3], &spheres(2000))])).expect("written");
    let began = std::time::Instant::now();
    let system = System::named(&path.display().to_string()).expect("a robot");
    let (seconds, points) = (began.elapsed().as_secs_f64(), &system.robot.contact_points);
    // Balls in a row reach as far as the two at its ends.
    let ends = points.iter().map(|p| p.local.z).fold([f64::MAX, f64::MIN], |[low, high], z| [low.min(z), high.max(z)]);
    assert!(seconds < 20.0 && points.len() <= 8, "{seconds:.1} s, {} points", points.len());
    assert!(ends[0].abs() < 1e-3 && (ends[1] - 1.999).abs() < 1e-3, "from {} m to {} m", ends[0], ends[1]);
}
