//! User robots, cables, and rapier as the truth, through the verbs.

use crate::{Folder, done, json, refused, root, text};

const LEAD: &str = "nerd-sim/assets/cables/lead.toml";

/// Lines of a specification without comments.
fn keys(text: &str) -> Vec<String> {
    text.lines().filter(|line| !line.starts_with('#')).map(String::from).collect()
}

/// The printed specification is a TOML that may be placed beside the robot's file.
#[test]
fn a_robot_alone_is_shown_as_toml() {
    let folder = Folder::new();
    let brick = folder.write(
        "brick.urdf",
        r#"<robot name="brick"><link name="brick"><inertial><mass value="2"/><inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0"
        iyz="0"/></inertial><collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link></robot>"#,
    );
    let first = done("inspect --robot", &[&brick]).0;
    assert!(first.contains("free base") && first.contains("floating = true"), "{first}");
    folder.write("brick.toml", &first);
    assert_eq!(keys(&first), keys(&done("inspect --robot", &[&brick]).0));
    // For a cable the printed keys are those outside `[cable]`.
    let printed = done(&format!("inspect --robot {LEAD}"), &[]).0;
    let lead = text(root().join(LEAD));
    let section = lead[lead.find("[cable]").expect("its section")..].split("\n\n").next().expect("itself");
    let own = folder.write("own.toml", format!("{printed}\n{section}\n"));
    assert_eq!(keys(&done("inspect --robot", &[&own]).0), keys(&printed));
}

#[test]
fn a_model_of_rapier_is_measured_against_rapier_alone() {
    const NAME: &str = "rapier 4 steps 4 iterations, own axes";
    let folder = Folder::new();
    let [data, out, table, charts] = ["data", "run", "table", "charts"].map(|name| folder.path(name));
    done("dataset --robot pendulum --truth rapier --transitions 2000 --out", &[&data]);
    let train = |truth: &str| {
        format!(
            "train --robot pendulum --base trapezoid --truth {truth} --data {} --recipe small --transitions 1000 --updates 6 --batch 16 \
             --rollouts 1 --out",
            data.display()
        )
    };
    refused(&train("articulated"), &[&folder.path("other")], NAME);
    done(&train("rapier"), &[&out]);
    let model = format!("--model {}", out.join("model").display());
    let evaluate =
        format!("evaluate --robot pendulum --scene ground1 --trajectories 2 --frames 5 --solver neural {model}");
    done(&format!("{evaluate} --out"), &[&table]);
    let row = &json(table.join("passive/result.json"))["rows"][0];
    assert_eq!((&row["truth"], &row["paper"]), (&NAME.into(), &serde_json::Value::Null), "{row}");
    refused(
        &format!("{evaluate} --truth articulated"),
        &[],
        "`rapier 4 steps 4 iterations, own axes`, not `articulated accurate`",
    );
    done(
        &format!("chart --robot pendulum --scene ground1 --trajectories 1 --frames 2 --max-substeps 1 {model} --out"),
        &[&charts],
    );
    assert!(charts.join("chart-pendulum-ground1/figure.svg").exists(), "no chart");
}
