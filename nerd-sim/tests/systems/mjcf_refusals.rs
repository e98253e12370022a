//! Files that MuJoCo's compiler refuses are refused here, too: one row for each kind of fault, in an otherwise valid
//! file.

use nerd_sim::prelude::*;

const RIGHT: &str = r#"<mujoco>
<compiler angle="radian" autolimits="true"/>
<default><default class="hard"><geom solref=".01 1"/><light mode="fixed"/></default></default>
<asset><texture name="grain" type="2d" builtin="flat" width="4" height="4"/><material name="wood" texture="grain" rgba="1 1 1 1"/></asset>
<worldbody>
<light dir="0 0 -1" class="hard"/>
<body name="arm"><joint name="turn" axis="0 0 1" range="-1 1"/><joint name="lift" type="slide" axis="0 0 1"/><geom name="rod" size=".1" material="wood" user="1 2"/>
<site name="tip"/><camera name="eye" fovy="60" target="arm"/></body>
<body name="base" childclass="hard" mocap="true"><geom name="foot" size=".1" friction="1 .1 .1"/></body>
</worldbody>
<tendon><fixed name="sum"><joint joint="turn" coef="2"/></fixed></tendon>
<equality><joint joint1="turn" joint2="lift" active="false"/></equality>
<contact><exclude name="kept" body1="arm" body2="base"/></contact>
<actuator><position name="a" joint="turn" kp="3" kv="1"/><motor name="b" joint="lift" ctrlrange="-1 1"/></actuator>
<sensor><jointpos name="s" joint="turn"/><framepos objtype="site" objname="tip"/><distance geom1="rod" geom2="foot"/><jointlimitpos joint="turn"/></sensor>
<custom><numeric name="n" data="1 2"/><tuple name="t"><element objtype="body" objname="arm"/></tuple></custom>
<keyframe><key name="home" qpos="0 .1" ctrl="0 0"/></keyframe>
</mujoco>"#;

fn read(from: &str, to: &str) -> Result<System, SystemError> {
    assert!(RIGHT.contains(from), "no `{from}` in the file");
    System::from_text("r", &RIGHT.replacen(from, to, 1), None)
}

/// Original text, replacement, and words of the refusal.
const WRONG: [(&str, &str, &str); 60] = [
    // Numbers: kind, count, size.
    ("1 1 1 1", "1 1 1", "line 4, <material> `wood`: rgba=\"1 1 1\" has 3 numbers; 4 are needed"),
    ("1 1 1 1", "1 1 1 1e300", "`1e300` is no number of single precision"),
    ("<compiler", "<visual><map znear=\"1e-300\"/></visual><compiler", "znear=\"1e-300\": it has to be > 0"),
    ("1 .1 .1", "1 .1 .1 .1", "has 4 numbers; 1 to 3 are needed"),
    ("0 0 -1", "0 0 x", "`x` is no number"),
    ("width=\"4\"", "width=\"4.5\"", "`4.5` is no whole number"),
    ("width=\"4\"", "width=\"2147483648\"", "is no whole number of 32 bits"),
    ("kp=\"3\"", "kp=\"1e400\"", "`1e400` is no number"),
    ("kv=\"1\"", "kv=\"-1\"", "kv=\"-1\": it has to be >= 0"),
    ("fovy=\"60\"", "fovy=\"180\"", "it has to be < 180"),
    ("name=\"s\"", "noise=\"-1\"", "noise=\"-1\": it has to be >= 0"),
    // Words.
    ("\"radian\"", "\"rad\"", "angle=\"rad\": it is one of radian, degree"),
    ("\"radian\"", "\"\"", "angle=\"\": it is one of"),
    ("mocap=\"true\"", "mocap=\"1\"", "mocap=\"1\": it is one of false, true"),
    ("builtin=\"flat\"", "builtin=\"plain\"", "it is one of none, gradient, checker, flat"),
    ("mode=\"fixed\"", "mode=\"off\"", "it is one of fixed, track"),
    ("\"site\"", "\"joint\"", "objtype=\"joint\": it is one of body, xbody, geom, site, camera"),
    ("fovy=\"60\"", "output=\"rgb rgb\"", "each once"),
    // Required, exclusive and joint attributes.
    (" joint=\"turn\"/><framepos", "/><framepos", "line 15, <jointpos> `s`: it needs `joint`"),
    (" coef=\"2\"", "", "it needs `coef`"),
    (" body2=\"base\"", "", "it needs `body2`"),
    (" geom1=\"rod\"", "", "it needs `body1`, or `geom1`"),
    ("geom1=\"rod\"", "geom1=\"rod\" body1=\"arm\"", "`body1` and `geom1` exclude each other; write one"),
    ("objname=\"tip\"", "objname=\"tip\" reftype=\"body\"", "it has `reftype` without `refname`"),
    ("fovy=\"60\"", "quat=\"1 0 0 0\" euler=\"0 0 0\"", "`euler` and `quat` exclude each other; write one"),
    ("kv=\"1\"", "kv=\"1\" dampratio=\"1\"", "`dampratio` and `kv` exclude each other"),
    ("joint=\"turn\"/><framepos", "joint=\"\"/><framepos", "its `joint` is empty"),
    // Names that are not there.
    (
        "\"wood\" user",
        "\"wod\" user",
        "line 7, <geom> `rod`: material=\"wod\": there is no such material; is `wood` meant?",
    ),
    ("texture=\"grain\"", "texture=\"grown\"", "texture=\"grown\": there is no such texture"),
    ("target=\"arm\"", "target=\"leg\"", "target=\"leg\": there is no such body"),
    (
        "<geom solref=\".01 1\"/>",
        "<geom material=\"glass\"/>",
        "<geom> `foot`: material=\"glass\": there is no such material",
    ),
    ("class=\"hard\"/>\n", "class=\"soft\"/>\n", "line 6, <light> `soft`: there is no default class `soft`"),
    ("childclass=\"hard\"", "childclass=\"\"", "there is no default class ``"),
    ("joint=\"turn\" coef", "joint=\"turm\" coef", "joint=\"turm\": there is no such hinge or slide; is `turn` meant?"),
    ("joint2=\"lift\"", "joint2=\"left\"", "joint2=\"left\": there is no such hinge or slide"),
    ("body2=\"base\"", "body2=\"bass\"", "body2=\"bass\": there is no such body"),
    ("joint=\"turn\"/><framepos", "joint=\"t\"/><framepos", "joint=\"t\": there is no such hinge or slide"),
    ("objname=\"tip\"", "objname=\"top\"", "objname=\"top\": there is no such site; is `tip` meant?"),
    ("<jointlimitpos joint=\"turn\"/>", "<jointlimitpos joint=\"lift\"/>", "there is no such limited joint"),
    ("<jointlimitpos joint=\"turn\"/>", "<ballquat joint=\"turn\"/>", "there is no such ball joint"),
    ("<jointlimitpos joint=\"turn\"/>", "<actuatorpos actuator=\"c\"/>", "actuator=\"c\": there is no such actuator"),
    ("objname=\"arm\"", "objname=\"arms\"", "there is no such body; is `arm` meant?"),
    // Duplicate names, and missing ones.
    ("name=\"b\" joint", "name=\"a\" joint", "line 14, <motor> `a`: another actuator is called `a`, too"),
    ("<key name=\"home\"", "<key name=\"home\"/><key name=\"home\"", "another key is called `home`, too"),
    ("name=\"wood\" texture", "texture", "line 4, <material>: it needs a name"),
    ("name=\"base\"", "name=\"world\"", "another body is called `world`, too"),
    ("<site name=\"tip\"/>", "<site name=\"tip\"/><site name=\"tip\"/>", "another site is called `tip`, too"),
    // Lists longer than the model.
    ("ctrl=\"0 0\"", "ctrl=\"0 0 0\"", "ctrl has 3 numbers; the file has 2 of them"),
    ("ctrl=\"0 0\"", "qvel=\"0 0 0\"", "qvel has 3 numbers; the file has 2 of them"),
    ("ctrl=\"0 0\"", "mpos=\"0 0 0 1\"", "mpos has 4 numbers; the file has 3 of them"),
    // The world, masses, ranges.
    ("<worldbody>", "<worldbody pos=\"0 0 1\">", "the world has no attributes; leave `pos` out"),
    ("<worldbody>", "<worldbody><inertial pos=\"0 0 0\" mass=\"1\"/>", "the world has no inertia"),
    (
        "size=\".1\" material",
        "size=\".1\" mass=\"0\" material",
        "line 7, <body> `arm`: it moves, and has no mass or no inertia",
    ),
    ("ctrlrange=\"-1 1\"", "ctrlrange=\"1 1\" ctrllimited=\"true\"", "has no width"),
    (" width=\"4\"", "", "line 4, <texture> `grain`: a builtin texture needs a width above zero"),
    ("<site name=\"tip\"/>", "<site name=\"tip\" type=\"box\" size=\"1 0 1\"/>", "numbers above zero are needed"),
    (
        "<compiler",
        "<size nuser_geom=\"1\"/><compiler",
        "<geom> `rod`: user has 2 numbers, and <size> lets a geom have 1",
    ),
    ("joint=\"lift\" ctrl", "joint=\"lift\" site=\"tip\" ctrl", "joint and site are its targets; write one"),
    (
        "joint=\"turn\" coef=\"2\"/>",
        "joint=\"turn\" coef=\"2\"/><joint joint=\"turn\" coef=\"1\"/>",
        "the tendon has this joint twice",
    ),
    ("joint2=\"lift\"", "joint2=\"turn\"", "joint1 and joint2 are the same"),
];

#[test]
fn what_mujocos_compiler_refuses_is_refused_in_a_line() {
    read("<mujoco>", "<mujoco>").unwrap_or_else(|e| panic!("the file without a fault: {e}"));
    let wrong = |(from, to, words): &(&str, &str, &str)| {
        let said = read(from, to).err().map(|e| e.to_string()).unwrap_or_default();
        let right = said.contains(words) && !said.contains('\n');
        (!right).then(|| format!("`{to}` for `{from}`: `{said}` does not say `{words}`"))
    };
    let wrong: Vec<String> = WRONG.iter().filter_map(wrong).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The converse: odd files that MuJoCo accepts.
#[test]
fn what_mujocos_compiler_takes_is_taken() {
    let taken = [
        ("1 1 1 1", ""),
        ("1 1 1 1", "nan inf 0 0"),
        ("qpos=\"0 .1\"", "qpos=\"0\""),
        ("\"wood\" user", "\"\" user"),
        ("<geom solref=\".01 1\"/>", "<site material=\"glass\"/>"),
        ("name=\"s\" joint", "joint"),
        ("name=\"tip\"", "name=\"tip\" user=\"1 2 3\""),
        ("<geom name=\"rod\" size=\".1\"", "<geom name=\"rod\" size=\".1\" type=\"ellipsoid\" fromto=\"0 0 0 0 0 1\""),
        ("body1=\"arm\"", "body1=\"world\""),
        ("objname=\"tip\"", "objname=\"tip\" reftype=\"xbody\" refname=\"world\""),
        (
            "type=\"2d\" builtin=\"flat\" width=\"4\" height=\"4\"/>",
            "type=\"2d\" builtin=\"flat\" width=\"4\" height=\"4\" nchannel=\"3\"/>",
        ),
    ];
    for (from, to) in taken {
        read(from, to).unwrap_or_else(|e| panic!("`{to}` for `{from}`: {e}"));
    }
}

/// The original name of copies stands for all of them, and each copy has a name.
#[test]
fn copies_are_spoken_of_by_both_names() {
    let text = |sensor: &str| {
        format!(
            r#"<mujoco><worldbody><replicate count="2" offset="1 0 0"><body name="b"><joint name="j"/><geom size=".1"/></body></replicate></worldbody>
            <actuator><motor name="m" joint="j"/></actuator><sensor>{sensor}</sensor></mujoco>"#
        )
    };
    for sensor in [r#"<jointpos joint="j"/>"#, r#"<jointpos joint="j1"/>"#, r#"<actuatorpos actuator="m0"/>"#] {
        System::from_text("r", &text(sensor), None).unwrap_or_else(|e| panic!("{sensor}: {e}"));
    }
    let said = System::from_text("r", &text(r#"<jointpos joint="j2"/>"#), None)
        .err()
        .map(|e| e.to_string())
        .unwrap_or_default();
    assert!(said.contains("joint=\"j2\": there is no such hinge or slide"), "`{said}`");
}
