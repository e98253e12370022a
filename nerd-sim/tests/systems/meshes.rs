//! Contact points of robots described by meshes: STL, OBJ, COLLADA, glTF and PLY.

use std::{f64::consts::TAU, path::Path};

use nerd_sim::{sampling::normal, scene::foot};
use rand::RngExt;

use super::common::*;

/// A binary STL of a box's twelve triangles, with these half edges (mm) and this header.
fn stl(half: [f32; 3], header: &str) -> Vec<u8> {
    let corner = |k: usize| [0, 1, 2].map(|axis| if k >> axis & 1 == 1 { half[axis] } else { -half[axis] });
    let faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let mut bytes = header.as_bytes().to_vec();
    bytes.resize(80, b' ');
    bytes.extend(12u32.to_le_bytes());
    for f in faces {
        for triangle in [[f[0], f[1], f[2]], [f[0], f[2], f[3]]] {
            bytes.extend([0u8; 12]);
            triangle.iter().for_each(|k| corner(*k).iter().for_each(|x| bytes.extend(x.to_le_bytes())));
            bytes.extend([0u8; 2]);
        }
    }
    bytes
}

/// A brick of 0.4 x 0.2 x 0.1 m with one shape, a mesh in a package beside it.
fn brick(folder: &Path, mesh: &str) -> std::path::PathBuf {
    let robots = folder.join("bricks/robots");
    std::fs::create_dir_all(&robots).expect("a folder");
    std::fs::create_dir_all(folder.join("bricks/meshes")).expect("a folder");
    let mesh = format!(r#"<mesh filename="{mesh}" scale="0.001 0.001 0.001"/>"#);
    let body = link("body", 2.0, [0.0; 3], [0.0083, 0.028, 0.033], &collision([0.0; 3], &mesh));
    std::fs::write(robots.join("brick.urdf"), urdf(&[body])).expect("a file");
    std::fs::write(robots.join("brick.toml"), keys(true, 9.81) + GROUND).expect("a file");
    robots.join("brick.urdf")
}

#[test]
fn a_mesh_is_touched_at_its_corners_and_carries_its_robot() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = brick(folder.path(), "package://bricks/meshes/brick.stl");
    // The header looks like a text STL's.
    std::fs::write(folder.path().join("bricks/meshes/brick.stl"), stl([200.0, 100.0, 50.0], "solid brick"))
        .expect("a file");
    let system = System::named(&path.display().to_string()).expect("a brick");
    assert!(system.meshes.is_empty() && system.notes.is_empty(), "{:?}", system.notes);
    assert_eq!(system.robot.contact_points.len(), 8);
    for p in &system.robot.contact_points {
        let off = (p.local.abs() - Vector3::new(0.2, 0.1, 0.05)).amax();
        assert!(off < 1e-6, "{:?} is {off:.1e} m from a corner", p.local);
    }
    // Dropped from 2 cm above the ground, it comes to rest on its large face.
    let mut state = system.default_state();
    state[2] = 0.07;
    let height = end(&mut implicit(16), at(&system, "ground", &state), 0.0, 180)[2];
    assert!((height - 0.05).abs() < 1e-3, "it rests at {height} m, half its height is 0.05 m");
}

fn with_mesh(name: &str, bytes: impl AsRef<[u8]>) -> std::sync::Arc<System> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = brick(folder.path(), &format!("package://bricks/meshes/{name}"));
    std::fs::write(folder.path().join("bricks/meshes").join(name), bytes).expect("a file");
    std::fs::write(folder.path().join("bricks/meshes/a b.bin"), [0; 12]).expect("a file");
    System::named(&path.display().to_string()).expect("a brick")
}

/// The bounding box of a file's vertices: its least and largest position (m).
fn extent(name: &str, bytes: impl AsRef<[u8]>) -> [[f64; 3]; 2] {
    let system = with_mesh(name, bytes);
    assert!(system.notes.is_empty(), "{:?}", system.notes);
    let all: Vec<_> = system.robot.contact_points.iter().map(|p| p.local).collect();
    [f64::min, f64::max].map(|pick| [0, 1, 2].map(|k| all.iter().map(|p| p[k]).reduce(pick).expect("a corner")))
}

/// Faces of an OBJ may refer to normals and textures or not; a hull uses the vertices. In a COLLADA file, nodes place a
/// geometry once for each reference to it.
#[test]
fn meshes_of_other_kinds_are_where_their_files_put_them() {
    let corners = (0..8).map(|k| [1, 2, 4].map(|bit| if k & bit == 0 { -100.0 } else { 100.0 }));
    let corners: Vec<String> = corners.map(|[x, y, z]: [f64; 3]| format!("{x} {y} {z}")).collect();
    let obj = corners.iter().map(|c| format!("v {c}\n")).collect::<String>()
        + "vn 0 0 1\nvt 0 0\nf 1//1 2//1 4//1\nf 1/1/1 2/1/1 3/1/1\nf 5 6 7\n";
    assert_eq!(extent("mixed.obj", &obj), [[-0.1; 3], [0.1; 3]]);
    let dae = |nodes: &str| {
        format!(
            r##"<COLLADA><asset><unit meter="2"/></asset><library_geometries><geometry id="g"><mesh><source id="p"><float_array id="f" count="24">{}</float_array>
            <technique_common><accessor source="#f" count="8" stride="3"/></technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
            </mesh></geometry></library_geometries><library_nodes><node id="n"><translate>0 0 500</translate><instance_geometry url="#g"/></node></library_nodes>
            <library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"##,
            corners.join(" ")
        )
    };
    // Scaled by 0.001 in the URDF and by the file's unit of 2 m.
    let twice = r##"<node><translate>1000 0 0</translate><instance_geometry url="#g"/></node><node><translate>-1000 0 0</translate><instance_geometry url="#g"/></node>"##;
    assert_eq!(extent("twice.dae", dae(twice)), [[-2.2, -0.2, -0.2], [2.2, 0.2, 0.2]]);
    // A quarter turn about x takes the z of the inner node to -y.
    let inner = r##"<node><rotate>1 0 0 90</rotate><scale>1 1 1</scale><instance_node url="#n"/></node>"##;
    let [low, high] = extent("inner.dae", dae(inner));
    let off = low
        .iter()
        .zip([-0.2, -1.2, -0.2])
        .chain(high.iter().zip([0.2, -0.8, 0.2]))
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max);
    assert!(off < 1e-9, "{low:?} to {high:?}, off by {off:.1e} m");
    // Sixty nodes that each show the next one twice, and a node that shows itself, end in a note.
    let doubling: String = (0..60)
        .map(|k| {
            format!(r##"<node id="d{k}">{}</node>"##, format!(r##"<instance_node url="#d{}"/>"##, k + 1).repeat(2))
        })
        .collect();
    for (nodes, what) in [
        (doubling + r#"<node id="d60"/>"#, "more than"),
        (r##"<node id="e"><instance_node url="#e"/></node>"##.into(), "nested"),
    ] {
        let notes = with_mesh("evil.dae", dae(&nodes)).notes.join(" ");
        assert!(notes.contains("evil.dae") && notes.contains(what), "{notes}");
    }
}

/// A glTF file of one vertex at the origin of its mesh, which nodes place.
fn gltf(nodes: &str, buffer: &str, accessor: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{nodes}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],
        "buffers":[{{"byteLength":12{buffer}}}],"bufferViews":[{{"buffer":0,"byteLength":12}}],
        "accessors":[{{"componentType":5126,"type":"VEC3","min":[0,0,0],"max":[0,0,0],{accessor}}}]}}"#
    )
}

const INSIDE: &str = r#","uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAA""#;
const ONE: &str = r#""bufferView":0,"count":1"#;

/// A glTF's nodes place its meshes, with the buffer inside, beside it or in a binary file. PLY is read as text and in
/// both byte orders.
#[test]
fn gltf_and_ply_are_where_their_files_put_them() {
    // A quarter turn about x takes a child node's z to -y.
    let nodes = r#"{"rotation":[0.70710678,0,0,0.70710678],"translation":[1000,0,0],"children":[1,2]},
        {"mesh":0,"translation":[0,0,500]},{"mesh":0,"scale":[2,2,2],"translation":[100,0,0]}"#;
    let right = [[1.0, -0.5, 0.0], [1.1, 0.0, 0.0]];
    let json = gltf(nodes, "", ONE);
    let padded = format!("{json}{}", " ".repeat(json.len().next_multiple_of(4) - json.len()));
    let mut glb = b"glTF".to_vec();
    for word in [2, (40 + padded.len()) as u32, padded.len() as u32, 0x4E4F_534A] {
        glb.extend(word.to_le_bytes());
    }
    glb.extend(padded.as_bytes());
    [12, 0x004E_4942, 0, 0, 0].iter().for_each(|word: &u32| glb.extend(word.to_le_bytes()));
    let files = [
        ("a.glb", glb),
        ("a.gltf", gltf(nodes, INSIDE, ONE).into()),
        ("b.gltf", gltf(nodes, r#","uri":"a%20b.bin""#, ONE).into()),
    ];
    for (name, bytes) in files {
        let off = extent(name, bytes)
            .as_flattened()
            .iter()
            .zip(right.as_flattened())
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(off < 1e-6, "{name}: off by {off:.1e} m");
    }
    let header = |format: &str, x: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment of ours\nelement camera 1\nproperty list uchar int a\nelement vertex 2\nproperty {x} x\nproperty uchar red\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let text = header("ascii", "double") + "2 7 8\n-100 255 200 50\n100 0 -200 -50\n3 0 1 9\n";
    assert_eq!(extent("text.ply", text), [[-0.1, -0.2, -0.05], [0.1, 0.2, 0.05]]);
    for (order, little) in [("binary_little_endian", true), ("binary_big_endian", false)] {
        let mut bytes = header(order, "float").into_bytes();
        bytes.push(0);
        for (x, y, z) in [(-100f32, 200f32, 50f32), (100.0, -200.0, -50.0)] {
            let put = |x: f32| if little { x.to_le_bytes() } else { x.to_be_bytes() };
            bytes.extend(put(x).into_iter().chain([255]).chain(put(y)).chain(put(z)));
        }
        assert_eq!(extent("binary.PLY", bytes), [[-0.1, -0.2, -0.05], [0.1, 0.2, 0.05]]);
    }
}

#[test]
fn a_mesh_that_asks_for_too_much_or_lacks_something_is_passed_over_and_said() {
    let ply = |vertices: &str, rest: &str| {
        format!("ply\nformat ascii 1.0\n{vertices}\nproperty float x\nproperty float y\n{rest}end_header\n1 2\n")
    };
    let doubling: String =
        (1..60).map(|k| format!(r#"{{"children":[{k},{k}]}},"#)).collect::<String>() + r#"{"mesh":0}"#;
    let sparse = r#""count":4000000000,"sparse":{"count":1,"indices":{"bufferView":0,"componentType":5121},"values":{"bufferView":0}}"#;
    let texts = [
        ("a.gltf", gltf(r#"{"children":[0]}"#, INSIDE, ONE), "nested"),
        ("a.gltf", gltf(&doubling, INSIDE, ONE), "more than"),
        ("a.gltf", gltf(r#"{"mesh":0}"#, INSIDE, sparse), "more than"),
        ("a.gltf", gltf(r#"{"mesh":0}"#, INSIDE, r#""bufferView":0,"count":3"#), "not in its buffers"),
        ("a.gltf", gltf(r#"{"mesh":7}"#, INSIDE, ONE), "mesh"),
        ("a.gltf", gltf(r#"{"mesh":0}"#, r#","uri":"gone.bin""#, ONE), "gone.bin"),
        ("a.gltf", gltf(r#"{"mesh":0}"#, "", ONE), "missing"),
        ("a.glb", "glTF".into(), "a.glb"),
        ("a.ply", "solid".into(), "a.ply"),
        ("a.ply", ply("element vertex 1000000000000000000", "property float z\n"), "more than"),
        ("a.ply", ply("element vertex 5", "property float z\n"), "vertex"),
        ("a.ply", ply("element vertex 1", ""), "`z`"),
        ("a.ply", ply("element face 1", ""), "no vertex"),
        ("a.stl", "version https://git-lfs.github.com/spec/v1\n".into(), "git lfs pull"),
        ("a.fbx", String::new(), ".fbx"),
        ("a.stl", "no mesh".into(), "a.stl"),
        ("a.stl", String::new(), "a.stl"),
    ];
    let bytes = [("a.stl", stl([f32::NAN; 3], ""), "not finite"), ("a.stl", stl([0.0; 3], ""), "no size")];
    for (name, bytes, word) in texts.map(|(name, text, word)| (name, text.into_bytes(), word)).into_iter().chain(bytes)
    {
        let system = with_mesh(name, bytes);
        let notes = system.notes.join(" ");
        assert_eq!((system.meshes.len(), system.robot.contact_points.len()), (1, 0));
        assert!(
            [word, "nothing touches it"].iter().all(|w| notes.contains(w)) && !notes.contains('\n'),
            "`{notes}` has no `{word}`"
        );
    }
}

/// A missing mesh is noted. With `mesh_points = 0` none is searched.
#[test]
fn a_mesh_that_is_not_there_is_said() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = brick(folder.path(), "package://bricks/meshes/brick.stl");
    let system = || System::named(&path.display().to_string()).expect("a robot");
    let notes = system().notes.join(" ");
    assert!(system().meshes.len() == 1 && notes.contains("brick.stl: is not there"), "{notes}");
    std::fs::write(folder.path().join("bricks/meshes/brick.stl"), stl([200.0, 100.0, 50.0], "")).expect("a file");
    let toml = path.with_extension("toml");
    let text = std::fs::read_to_string(&toml).expect("a TOML");
    std::fs::write(&toml, format!("mesh_points = 0\n{text}")).expect("a file");
    assert!(system().robot.contact_points.is_empty());
}

/// In any attitude, one of few contact points is within 2 mm of the lowest point of vertices, balls and wheels.
#[test]
fn the_lowest_place_is_a_contact_point_in_every_attitude() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut rng = stream(3, 0);
    let mut ball = |count: usize, half: [f64; 3]| -> Vec<Vector3<f64>> {
        let one = |_| Vector3::from_fn(|_, _| normal(&mut rng)).normalize().component_mul(&Vector3::from(half));
        (0..count).map(one).collect()
    };
    // An ellipsoid as trunk; shins that narrow to a ball, with a hidden capsule; a sole; two tyres.
    let sides = (0..120).map(|k| (f64::from(k) * TAU / 120.0).sin_cos());
    let profile = [[-0.02, 0.085], [-0.01, 0.1], [0.01, 0.1], [0.02, 0.085]];
    let tyre = sides.flat_map(|(sin, cos)| profile.map(|[y, r]| Vector3::new(r * cos, y, r * sin))).collect();
    let meshes = [
        ("trunk", ball(500, [0.3, 0.15, 0.1])),
        ("shin", ball(200, [0.03, 0.02, 0.2])),
        ("sole", ball(100, [0.1, 0.05, 0.01])),
        ("tyre", tyre),
    ];
    for (name, vertices) in &meshes {
        let text: String = vertices.iter().map(|v| format!("v {} {} {}\n", v.x, v.y, v.z)).collect();
        std::fs::write(folder.path().join(format!("{name}.obj")), text).expect("a file");
    }
    let mesh = |name: &str| collision([0.0; 3], &format!(r#"<mesh filename="{name}.obj"/>"#));
    let (foot_at, foot_radius) = ([0.0, 0.0, -0.22], 0.03);
    let ends = collision(foot_at, r#"<sphere radius="0.03"/>"#)
        + &collision([0.0; 3], r#"<capsule radius="0.01" length="0.1"/>"#);
    let mut parts = vec![link("trunk", 5.0, [0.0; 3], [0.1; 3], &mesh("trunk"))];
    for (k, (name, more, kind)) in [
        ("shin", ends.as_str(), "revolute"),
        ("shin", &ends, "revolute"),
        ("sole", "", "revolute"),
        ("tyre", "", "continuous"),
        ("tyre", "", "continuous"),
    ]
    .into_iter()
    .enumerate()
    {
        let own = format!("{name}{k}");
        parts.push(link(&own, 0.5, [0.0; 3], [0.01; 3], &(mesh(name) + more)));
        let inner = format!(
            r#"<origin xyz="{} 0.2 -0.1"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="9" velocity="9"/>"#,
            0.2 * k as f64 - 0.4
        );
        parts.push(joint(&format!("joint{k}"), kind, ["trunk", &own], &inner));
    }
    let path = folder.path().join("robot.urdf");
    std::fs::write(&path, urdf(&parts)).expect("a file");
    let system = System::named(&path.to_string_lossy()).expect("a robot");
    let (robot, mut data) = (&system.robot, Data::new(&system.robot));
    let of = |link: usize| robot.contact_points.iter().filter(move |p| p.link == link);
    assert!(
        of(1).filter(|p| p.radius > 1e-3).map(|p| p.radius).eq([foot_radius]),
        "the foot is a ball, and the capsule is hidden"
    );
    assert!(of(4).filter(|p| matches!(p.locus, Locus::Rim { .. })).count() >= 6, "a tyre rolls");
    let mut worst: f64 = 0.0;
    for k in 0..51 {
        let mut state = system.default_state();
        if k > 0 {
            let turn = nalgebra::Vector4::from_fn(|_, _| normal(&mut rng)).normalize();
            state[3..7].copy_from_slice(turn.as_slice());
            state[7..12].iter_mut().for_each(|q| *q = rng.random_range(-1.0..1.0));
        }
        kinematics(robot, &state, &mut data);
        let mut lowest = f64::INFINITY;
        for (link, name) in robot.links.iter().map(|l| l.name.trim_end_matches(char::is_numeric)).enumerate() {
            let vertices = meshes.iter().find(|(mesh, _)| *mesh == name).map(|(_, vertices)| vertices);
            let deepest =
                vertices.into_iter().flatten().map(|v| point_position(&data, link, v).z).fold(f64::INFINITY, f64::min);
            let ball = if name == "shin" {
                point_position(&data, link, &foot_at.into()).z - foot_radius
            } else {
                f64::INFINITY
            };
            lowest = lowest.min(deepest).min(ball);
        }
        let found = robot.contact_points.iter().map(|p| foot(p, &data, &Vector3::z())).fold(f64::INFINITY, f64::min);
        worst = worst.max((found - lowest).abs());
    }
    assert!(worst < 2e-3, "the lowest contact point is {worst} m from the lowest place");
    assert!(robot.contact_points.len() < 60, "{} contact points", robot.contact_points.len());
}

/// Deep nesting, in a mesh's file or in the poses beside a URDF, does not crash a recursive reader.
#[test]
fn files_beside_a_robot_that_are_nested_deep_are_passed_over() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, deep) = (brick(folder.path(), "package://bricks/meshes/brick.dae"), "<a>".repeat(100_000));
    std::fs::write(folder.path().join("bricks/meshes/brick.dae"), format!("<COLLADA>{deep}")).expect("a file");
    std::fs::create_dir_all(folder.path().join("bricks/srdf")).expect("a folder");
    std::fs::write(folder.path().join("bricks/srdf/brick.srdf"), &deep).expect("a file");
    let notes = System::named(&path.display().to_string()).expect("a brick").notes.join("; ");
    assert!(notes.contains("elements nested more than 256 deep"), "{notes}");
    // Poses of an SRDF are looked for where no TOML gives them.
    std::fs::remove_file(path.with_extension("toml")).expect("removed");
    System::named(&path.display().to_string()).expect("a brick");
}
