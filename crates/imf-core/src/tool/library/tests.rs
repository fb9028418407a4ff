//! Libraries as the programs write them, and tools by hand beside them.

use std::path::PathBuf;

use serde_json::{Value, json};
use tempfile::{TempDir, tempdir};

use super::*;
use crate::tool::{Element, ElementKind, Segment};
use crate::unit::LengthUnit;

mod fusion;

fn write(folder: &TempDir, name: &str, content: &Value) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, content.to_string()).unwrap();
    path
}

/// The only tool of a library, or the error's text.
fn read(name: &str, content: &Value) -> Result<Tool, String> {
    let folder = tempdir().unwrap();
    Tool::read(&write(&folder, name, content)).map_err(|error| error.to_string())
}

fn elements(tool: &Tool) -> &[Element] {
    // Stacked without gaps.
    let mut height = 0.0;
    for segment in tool.segments() {
        assert!((segment.range().0 - height).abs() < 1e-9, "{:?}", tool.shape);
        height = segment.range().1;
    }
    tool.elements()
}

/// Radius of a tool at a height.
fn radius(tool: &Tool, height: f64) -> f64 {
    let mut all = elements(tool).iter().flat_map(|element| &element.profile);
    all.find(|s| s.range().0 <= height && height < s.range().1).unwrap().radius(height)
}

fn bit(shape: &str, parameter: Value) -> Value {
    let mut bit = json!({
        "version": 2, "name": "a bit", "shape": format!("{}.fcstd", shape.to_lowercase()), "shape-type": shape,
        "attribute": {}
    });
    bit["parameter"] = parameter;
    bit
}

fn close(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-9, "{found} against {expected}");
}

#[test]
fn names_with_a_hash_are_found_behind_the_library() {
    let of = |text: &'static str| {
        let (path, tool) = location(text);
        (path.to_str().unwrap().to_owned(), tool)
    };
    assert_eq!(of("no/shop.json##7 drill"), ("no/shop.json".to_owned(), Some("#7 drill")));
    assert_eq!(of("no#1/shop.tools#5"), ("no#1/shop.tools".to_owned(), Some("5")));
    assert_eq!(of("no/shop.json#a#b"), ("no/shop.json".to_owned(), Some("a#b")));
    assert_eq!(of("no/mill.toml"), ("no/mill.toml".to_owned(), None));
}

#[test]
fn freecads_bits_become_cutter_and_shank() {
    let read = |content: &Value| read("bit.fctb", content);
    let bullnose = bit(
        "Bullnose",
        json!({
            "CuttingEdgeHeight": "40.0000 mm", "Diameter": "6.0000 mm", "CornerRadius": "1.5000 mm",
            "Length": "50.0000 mm", "ShankDiameter": "3.0000 mm"
        }),
    );
    let tool = read(&bullnose).unwrap();
    assert_eq!((tool.name.as_str(), tool.unit, tool.length()), ("a bit", LengthUnit::Mm, 50.0));
    let kinds: Vec<_> = elements(&tool).iter().map(|e| e.kind).collect();
    assert_eq!(kinds, [ElementKind::Cutter, ElementKind::Shank]);
    close(radius(&tool, 0.0), 1.5);
    close(radius(&tool, 1.5), 3.0);
    close(radius(&tool, 45.0), 1.5);
    // By its flat bottom instead, which is no wider than the cutter.
    let by_flat = |flat: &str| {
        read(&bit(
            "Bullnose",
            json!({
                "CuttingEdgeHeight": "40 mm", "Diameter": "6 mm", "FlatRadius": flat, "Length": "50 mm", "ShankDiameter": "3 mm"
            }),
        ))
    };
    close(radius(&by_flat("1.5 mm").unwrap(), 0.0), 1.5);
    assert!(by_flat("3.5 mm").unwrap_err().contains("FlatRadius"));

    // Inches, a localised decimal sign, and a stick-out that cuts the shank off.
    let end_mill = bit(
        "Endmill",
        json!({
            "CuttingEdgeHeight": "0,5 in", "Diameter": "0.1250 in", "Length": "2.5000 in", "ShankDiameter": "3.175 mm",
            "Stickout": "1.3650 in", "Flutes": 2, "Material": "Carbide"
        }),
    );
    let tool = read(&end_mill).unwrap();
    close(tool.length(), 1.365 * 25.4);
    close(elements(&tool)[0].profile[0].range().1, 12.7);
    close(radius(&tool, 1.0), 0.0625 * 25.4);

    // No shape-type, and a shape in a folder; the whole of a drill cuts.
    let mut drill =
        bit("", json!({"Diameter": "5.0000 mm", "Length": "50.0000 mm", "TipAngle": "120.0000 \u{b0}"}));
    drill["shape"] = json!("Shape/drill.fcstd");
    let tool = read(&drill).unwrap();
    close(radius(&tool, 0.0), 0.0);
    close(radius(&tool, 0.5), 0.5 * 60.0_f64.to_radians().tan());
    close(radius(&tool, 40.0), 2.5);

    let ball = bit(
        "Ballend",
        json!({"CuttingEdgeHeight": 40, "Diameter": 6, "Length": "50 mm", "ShankDiameter": "3 mm"}),
    );
    close(radius(&read(&ball).unwrap(), 1.0), (9.0_f64 - 4.0).sqrt());
    let tapered = |edge: &str, widest: &str| {
        bit(
            "TaperedBallNose",
            json!({
                "CuttingEdgeHeight": edge, "Diameter": "2 mm", "TaperAngle": "20 °", "TaperDiameter": widest, "Length": "50 mm",
                "ShankDiameter": "6 mm"
            }),
        )
    };
    let tool = read(&tapered("20 mm", "6 mm")).unwrap();
    let (sine, cosine) = 10.0_f64.to_radians().sin_cos();
    close(radius(&tool, 0.5), 0.75_f64.sqrt());
    // The cone touches the ball, and ends where it is as wide as it says.
    close(radius(&tool, 1.0 - sine), cosine);
    close(radius(&tool, 5.0), cosine + (4.0 + sine) * sine / cosine);
    let top = 1.0 - sine + (3.0 - cosine) * cosine / sine;
    assert!(top < 19.0);
    close(radius(&tool, top), 3.0);
    close(radius(&tool, 19.0), 3.0);
    for (edge, widest) in [("10 mm", "6 mm"), ("20 mm", "1.5 mm")] {
        let refused = read(&tapered(edge, widest)).unwrap_err();
        assert!(refused.contains("TaperDiameter is") && refused.contains("a cone from 2 to"), "{refused}");
    }

    let pointed = bit(
        "V-Bit",
        json!({
            "CuttingEdgeAngle": "60 °", "Diameter": "10 mm", "CuttingEdgeHeight": "1 mm", "TipDiameter": "0.1 mm",
            "Length": "20 mm", "ShankDiameter": "5 mm"
        }),
    );
    let tool = read(&pointed).unwrap();
    let point = 4.95 / 30.0_f64.to_radians().tan();
    close(radius(&tool, 0.0), 0.05);
    close(elements(&tool)[0].profile[1].range().1, point + 1.0);
}

#[test]
fn a_chamfers_cone_is_as_high_as_its_edge() {
    // FreeCAD's own bit of 45 degrees, whose sketch has nothing of the diameter.
    let chamfer = bit(
        "Chamfer",
        json!({
            "CuttingEdgeAngle": "45 °", "Diameter": "12.33 mm", "CuttingEdgeHeight": "6.35 mm", "TipDiameter": "5 mm",
            "Length": "20 mm", "ShankDiameter": "6.35 mm"
        }),
    );
    let tool = read("bit.fctb", &chamfer).unwrap();
    close(radius(&tool, 3.0), 2.5 + 3.0 * 22.5_f64.to_radians().tan());
    let Segment::Line { to, radius_to, .. } = elements(&tool)[0].profile[0] else { panic!() };
    close(to, 6.35);
    close(radius_to, 2.5 + 6.35 * 22.5_f64.to_radians().tan());
    close(radius(&tool, 7.0), 3.175);
}

#[test]
fn what_freecad_has_and_we_do_not_is_refused_by_name() {
    for (content, expected) in [
        (bit("Probe", json!({"Diameter": "6 mm", "Length": "20 mm"})), "'probe'"),
        (bit("Endmill", json!({"Diameter": "6 mm", "Length": "20 mm"})), "CuttingEdgeHeight is missing"),
        (bit("Endmill", json!({"Diameter": "6 parsec", "Length": "20 mm"})), "'parsec' is not a unit"),
        (bit("Endmill", json!({"Diameter": "-6 mm", "Length": "20 mm"})), "negative"),
        (bit("Endmill", json!({"Diameter": "six", "Length": "20 mm"})), "no length"),
        (
            bit("Ballend", json!({"Diameter": "6 mm", "Length": "20 mm", "CuttingEdgeHeight": "2 mm"})),
            "shorter than its rounded end",
        ),
        (json!({"name": "none"}), "parameter"),
    ] {
        let error = read("bit.fctb", &content).unwrap_err();
        assert!(error.contains("bit.fctb") && error.contains(expected), "{error}");
    }
}
