//! Height fields of an MJCF's world, against MuJoCo 4.0.0 on the same text.

use super::common::{Field, at, end, implicit};
use nerd_sim::prelude::*;

/// Rows of heights, the row of the largest y first.
const DRAWN: [[u8; 4]; 3] = [[0, 50, 100, 0], [50, 100, 150, 0], [100, 150, 200, 0]];

/// Frictionless balls on vertical slides, above two fields and a plane. MuJoCo's friction creeps and would not hold the
/// balls. They are not `simple`, since MuJoCo takes a simple body for three times as light.
fn file(drawn: &str) -> String {
    let ball = |[x, y]: [f64; 2]| {
        format!(
            r#"<body simple="false" pos="{x} {y} 2"><joint type="slide" axis="0 0 1" damping="2"/><geom size=".1" mass="1"/></body>"#
        )
    };
    let balls: String = PLACES.map(ball).concat();
    format!(
        r#"<mujoco><default><geom condim="1"/></default><asset><hfield name="inline" nrow="3" ncol="4" size="1.5 1 .8 .1" elevation="2 3 4 5 1 2 3 4 0 1 2 3"/>
        <hfield name="drawn" file="{drawn}" size="1.5 1 .8 .1"/></asset><worldbody><geom type="plane" size="0 0 1" pos="0 0 -.05"/>
        <geom type="hfield" hfield="inline" pos="0 0 .2" euler="0 0 90"/><geom type="hfield" hfield="drawn" pos="5 0 0"/>{balls}</worldbody>
        </mujoco>"#
    )
}

/// Positions (x, y) of balls, and their heights (m) in MuJoCo after 10 s. Two are on each field, one beside the first.
const PLACES: [[f64; 2]; 5] = [[0.3, 0.4], [-0.7, -1.2], [5.2, 0.35], [4.0, -0.6], [1.3, 0.0]];
const HEIGHTS: [f64; 5] = [0.718379, 0.622379, 0.573770, 0.523770, 0.049858];

/// A greyscale PNG of the heights in 8 bits, or in 16 bits with an arbitrary lower byte, which is ignored.
fn picture(path: &std::path::Path, wide: bool) {
    let mut encoder = png::Encoder::new(std::fs::File::create(path).expect("a file"), 4, 3);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(if wide { png::BitDepth::Sixteen } else { png::BitDepth::Eight });
    let bytes = DRAWN.as_flattened().iter().flat_map(|x| std::iter::once(*x).chain(wide.then_some(x ^ 0x5a)));
    let bytes: Vec<u8> = bytes.collect();
    encoder.write_header().and_then(|mut writer| writer.write_image_data(&bytes)).expect("a picture");
}

#[test]
fn balls_rest_on_height_fields_as_in_mujoco() {
    let folder = tempfile::tempdir().expect("a folder");
    picture(&folder.path().join("eight.png"), false);
    picture(&folder.path().join("sixteen.PNG"), true);
    let rows = DRAWN.iter().rev().flatten().map(|x| f32::from(*x)).flat_map(f32::to_le_bytes);
    let own: Vec<u8> = [3, 4].into_iter().flat_map(i32::to_le_bytes).chain(rows).collect();
    std::fs::write(folder.path().join("own.bin"), own).expect("a file");
    for drawn in ["eight.png", "sixteen.PNG", "own.bin"] {
        let path = folder.path().join("robot.xml");
        std::fs::write(&path, file(drawn)).expect("a file");
        let system = System::named(&path.to_string_lossy()).unwrap_or_else(|e| panic!("{drawn}: {e}"));
        let frames = (5.0 / system.frame_time).round() as usize;
        let last = end(&mut implicit(8), at(&system, "ground", &system.robot.zero_state()), 0.0, frames);
        for (k, height) in HEIGHTS.iter().enumerate() {
            let own = 2.0 + last[k];
            assert!((own - height).abs() < 5e-6, "{drawn}, ball {k}: it rests {own:.6} m high, in MuJoCo {height} m");
        }
    }
}

/// A point beside a block, at its edges, inside it and below it: distances (m) and normals by hand.
#[test]
fn a_height_field_of_a_file_ends() {
    let field = Field::block([1.0, 0.5], [3, 3], vec![0.3; 9], 0.2).expect("nine heights");
    let body = Collider::terrain(field, Isometry3::identity(), Material::default());
    let scene = Scene { colliders: vec![body], ..Scene::free(-Vector3::z()) };
    for ([x, y, z], distance, normal) in [
        ([0.9, -0.4, 0.5], 0.2, Vector3::z()),
        ([0.9, 0.1, 0.25], -0.05, Vector3::z()),
        ([1.4, 0.0, 0.1], 0.4, Vector3::x()),
        ([-0.97, 0.0, 0.1], -0.03, -Vector3::x()),
        ([0.0, -9.0, -0.1], 8.5, -Vector3::y()),
        ([0.0, 0.1, -0.5], 0.3, -Vector3::z()),
    ] {
        let event = scene.contact(&Vector3::new(x, y, z));
        assert!(
            (event.distance - distance).abs() < 1e-12,
            "at {x} {y} {z}: {} m away, {distance} by hand",
            event.distance
        );
        assert!((event.normal - normal).norm() < 1e-12, "at {x} {y} {z}: {:?}", event.normal);
    }
}

#[test]
fn height_fields_that_mujoco_refuses_are_refused_by_line() {
    let said = |asset: &str, geom: &str| {
        let text = format!(
            "<mujoco><asset>\n{asset}</asset><worldbody><geom {geom}/><body><joint/><geom size=\".1\"/></body></worldbody></mujoco>"
        );
        System::from_text("r", &text, None).err().map(|e| e.to_string()).unwrap_or_default()
    };
    let (flat, geom) = (r#"<hfield name="h" nrow="2" ncol="2" size="1 1 1 1"/>"#, r#"type="hfield" hfield="h""#);
    assert_eq!(said(flat, geom), "");
    for (asset, geom, words) in [
        (flat, r#"type="hfield""#, "line 2, <geom>: it names no hfield"),
        (flat, r#"type="hfield" hfield="hill""#, "line 2, <geom>: hfield=\"hill\": there is no such hfield"),
        (&flat.replace(r#"nrow="2""#, r#"nrow="1""#), geom, "line 2, <hfield> `h`: nrow is 1"),
        (&flat.replace("1 1 1 1", "1 1 0 1"), geom, "line 2, <hfield> `h`: size has four numbers above zero"),
        (
            &flat.replace("size", r#"elevation="1 2 3" size"#),
            geom,
            "line 2, <hfield> `h`: elevation has 3 numbers, not nrow x ncol, which are 4",
        ),
        (&flat.repeat(2), geom, "another height field is called `h`"),
    ] {
        let said = said(asset, geom);
        assert!(said.contains(words) && !said.contains('\n'), "`{said}`, not `{words}`");
    }
    // A missing file: its field touches nothing, and a note says so.
    let lost = r#"<mujoco><asset><hfield name="h" file="none.png" size="1 1 1 1"/></asset><worldbody><geom type="hfield" hfield="h"/>
        <body><joint/><geom size=".1"/></body></worldbody></mujoco>"#;
    let lost = System::from_text("r", lost, None).expect("a robot");
    assert!(
        lost.notes.iter().any(|note| note.contains("touches nothing: its height field, ./none.png: ")),
        "{:?}",
        lost.notes
    );
}
