//! Archives made by hand: what is placed where, in which unit, and what is refused.

use std::io::Write as _;

use glam::DVec3;

use super::super::tests::mesh_of;
use super::*;
use crate::mesh::tests::unit_cube;
use crate::unit::LengthUnit;

const CORE: &str = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02";
const PRODUCTION: &str = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06";

/// An archive of one model, packed.
fn archive(model: &str) -> Vec<u8> {
    archive_of(&[("3D/part.model", model)])
}

/// An archive whose first model is the root.
fn archive_of(models: &[(&str, &str)]) -> Vec<u8> {
    archive_with(models[0].0, models)
}

/// An archive whose root has this name in the relationships.
fn archive_with(root: &str, models: &[(&str, &str)]) -> Vec<u8> {
    let relationships = format!(
        r#"<?xml version="1.0"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
        <Relationship Id="r1" Type="http://schemas.openxmlformats.org/package/2006/relationships/metadata/thumbnail" Target="/t.png"/>
        <Relationship Id="r2" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel" Target="/{root}"/></Relationships>"#
    );
    let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options =
        zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
    for (name, text) in [("_rels/.rels", relationships.as_str())].iter().chain(models) {
        writer.start_file(*name, options).unwrap();
        writer.write_all(text.as_bytes()).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

fn mesh_text(mesh: &Mesh) -> String {
    let vertices = mesh.vertices.iter().map(|v| format!(r#"<vertex x="{}" y="{}" z="{}" />"#, v.x, v.y, v.z));
    let triangles =
        mesh.triangles.iter().map(|[a, b, c]| format!(r#"<triangle v1="{a}" v2="{b}" v3="{c}" p1="0" />"#));
    let (vertices, triangles) = (vertices.collect::<String>(), triangles.collect::<String>());
    format!("<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>")
}

/// A model of resources and items.
fn model(attributes: &str, resources: &str, items: &str) -> String {
    format!(
        r##"<?xml version="1.0" encoding="UTF-8"?>
        <model xml:lang="en-US" xmlns="{CORE}" xmlns:p="{PRODUCTION}" {attributes}>
        <metadata name="Title">a part &amp; more</metadata>
        <resources><basematerials id="9"><base name="steel" displaycolor="#808080"/></basematerials>{resources}</resources>
        <build>{items}</build></model>"##
    )
}

/// A mesh as the only object, placed as it is.
fn cube(mesh: &Mesh) -> String {
    let object = format!(r#"<object id="1" type="model">{}</object>"#, mesh_text(mesh));
    model(r#"unit="millimeter""#, &object, r#"<item objectid="1"/>"#)
}

fn bounds(bytes: &[u8]) -> (DVec3, DVec3, LengthUnit) {
    let file = parse(bytes).unwrap();
    let (lower, upper) = file.mesh.bounds().unwrap();
    (lower, upper, file.unit.unwrap())
}

fn refusal(bytes: &[u8]) -> String {
    mesh_of(bytes, parse).unwrap_err()
}

#[test]
fn names_may_be_percent_encoded() {
    let expected = bounds(&archive(&cube(&unit_cube())));
    for [target, entry] in [["my%20t%C3%B6p.model", "my töp.model"], ["my töp.model", "my%20t%C3%B6p.model"]]
    {
        assert_eq!(bounds(&archive_with(target, &[(entry, &cube(&unit_cube()))])), expected, "{target}");
    }
}

#[test]
fn volumes_that_a_slicer_says_are_no_part_are_refused() {
    let text = cube(&unit_cube());
    for (name, settings, is_read) in [
        (
            "Metadata/Slic3r_PE_model.config",
            r#"<metadata type="volume" key="volume_type" value="ModelPart"/>"#,
            true,
        ),
        (
            "Metadata/Slic3r_PE_model.config",
            r#"<metadata type="volume" key="volume_type" value="NegativeVolume"/>"#,
            false,
        ),
        ("Metadata/model_settings.config", r#"<part id="2" subtype="negative_part">"#, false),
        ("Metadata/model_settings.config", r#"<metadata key="name" value="negative_part"/>"#, true),
    ] {
        let bytes = archive_of(&[("3D/part.model", &text), (name, settings)]);
        match is_read {
            true => assert_eq!(parse(&bytes).unwrap().mesh.triangles.len(), 12),
            false => assert!(refusal(&bytes).contains("no part"), "{}", refusal(&bytes)),
        }
    }
}

#[test]
fn a_mesh_is_read_in_the_files_unit() {
    let cube_text = cube(&unit_cube());
    let read = parse(&archive(&cube_text)).unwrap();
    assert_eq!(read, MeshFile { mesh: unit_cube().welded(), unit: Some(LengthUnit::Mm) });
    for (name, size, unit) in [
        ("micron", 1e-3, LengthUnit::Mm),
        ("centimeter", 1.0, LengthUnit::Cm),
        ("inch", 1.0, LengthUnit::Inch),
        ("foot", 12.0, LengthUnit::Inch),
        ("meter", 1.0, LengthUnit::M),
    ] {
        let text = cube_text.replace("millimeter", name);
        assert_eq!(bounds(&archive(&text)), (DVec3::ZERO, DVec3::splat(size), unit));
    }
    // A file that states no unit is in millimetres.
    let text = cube_text.replace(r#"unit="millimeter""#, "");
    assert_eq!(bounds(&archive(&text)).2, LengthUnit::Mm);
    assert!(refusal(&archive(&cube_text.replace("millimeter", "furlong"))).contains("'furlong'"));
}

#[test]
fn items_and_components_are_placed_by_their_transforms() {
    // A quarter turn about z, then a shift: x goes to y, y to −x.
    let turn = "0 1 0 -1 0 0 0 0 1 10 0 0";
    let objects = format!(
        r#"<object id="1">{}</object>
           <object id="2"><components><component objectid="1" transform="2 0 0 0 1 0 0 0 1 0 0 5"/></components></object>
           <object id="3" type="support">{}</object>"#,
        mesh_text(&unit_cube()),
        mesh_text(&unit_cube())
    );
    let items = format!(r#"<item objectid="2" transform="{turn}"/><item objectid="3"/>"#);
    let bytes = archive(&model("", &objects, &items));
    let (lower, upper, _) = bounds(&bytes);
    // The component stretches along x and lifts; the item turns that and shifts.
    assert!((lower - DVec3::new(9.0, 0.0, 5.0)).length() < 1e-12, "{lower}");
    assert!((upper - DVec3::new(10.0, 2.0, 6.0)).length() < 1e-12, "{upper}");

    // A mirrored item still faces outwards, and two items are two bodies.
    let items = r#"<item objectid="1"/><item objectid="1" transform="-1 0 0 0 1 0 0 0 1 9 0 0"/>"#;
    let mesh = parse(&archive(&model("", &objects, items))).unwrap().mesh;
    assert!((mesh.signed_volume() - 2.0).abs() < 1e-12);
}

#[test]
fn what_is_not_to_be_printed_is_not_the_part() {
    let objects = format!(
        r#"<object id="1">{0}</object><object id="2" type="other">{0}</object>"#,
        mesh_text(&unit_cube())
    );
    let both = r#"<object id="3"><components><component objectid="1"/>
        <component objectid="2" transform="1 0 0 0 1 0 0 0 1 5 0 0"/></components></object>"#;
    let read = |items: &str| archive(&model("", &format!("{objects}{both}"), items));
    let shifted =
        |x: u32, more: &str| format!(r#"<item objectid="1" transform="1 0 0 0 1 0 0 0 1 {x} 0 0"{more}/>"#);
    for left_out in [r#" printable="0""#, r#" printable="false""#] {
        let items = [shifted(0, ""), shifted(7, left_out), shifted(3, r#" printable="1""#)].concat();
        assert_eq!(bounds(&read(&items)).1, DVec3::new(4.0, 1.0, 1.0), "{left_out}");
        let error = refusal(&read(&shifted(0, left_out)));
        assert!(error.contains("nothing of its build is to be printed"), "{error}");
    }
    // A slicer's region within an object is not a material; as an item of its own it is against the specification.
    assert_eq!(bounds(&read(r#"<item objectid="3"/>"#)).1, DVec3::ONE);
    assert!(refusal(&read(r#"<item objectid="2"/>"#)).contains("'other'"));
}

#[test]
fn components_may_lie_in_other_models() {
    let part = format!(r#"<object id="1">{}</object>"#, mesh_text(&unit_cube()));
    let part = model("", &part, "");
    let part = part.replace("<build></build>", "<build/>");
    let whole = r#"<object id="1"><components>
        <component p:path="/3D/Objects/a.model" objectid="1" transform="1 0 0 0 1 0 0 0 1 3 0 0"/></components></object>"#;
    let root = model(r#"requiredextensions="p""#, whole, r#"<item objectid="1" p:UUID="x"/>"#);
    let (lower, _, _) = bounds(&archive_of(&[("3D/3dmodel.model", &root), ("3D/Objects/a.model", &part)]));
    assert_eq!(lower, DVec3::new(3.0, 0.0, 0.0));
    let error = refusal(&archive(&root));
    assert!(error.contains("3D/Objects/a.model"), "{error}");
    let inches = part.replace("<model ", r#"<model unit="inch" "#);
    let mixed = archive_of(&[("3D/3dmodel.model", &root), ("3D/Objects/a.model", &inches)]);
    assert!(refusal(&mixed).contains("different units"));
}

#[test]
fn elements_of_other_namespaces_are_not_ours() {
    let text = cube(&unit_cube())
        .replace("<vertices>", r#"<vertices><x:vertex xmlns:x="urn:x" x="9" y="9" z="9"/>"#);
    assert_eq!(bounds(&archive(&text)).1, DVec3::ONE);
    // The core may have a prefix.
    let mut prefixed = cube(&unit_cube()).replace("xmlns=", "xmlns:c=");
    let names = "model resources object mesh vertices triangles vertex triangle build item";
    for name in names.split(' ') {
        for (from, to) in [("<", "<c:"), ("</", "</c:")] {
            for end in [" ", ">"] {
                prefixed = prefixed.replace(&format!("{from}{name}{end}"), &format!("{to}{name}{end}"));
            }
        }
    }
    assert_eq!(bounds(&archive(&prefixed)).1, DVec3::ONE);
}

#[test]
fn broken_files_are_named_with_what_is_wrong() {
    let whole = cube(&unit_cube());
    let with = |from: &str, to: &str| {
        assert!(whole.contains(from), "{from}");
        refusal(&archive(&whole.replacen(from, to, 1)))
    };
    for (from, to, expected) in [
        (r#"v1="0""#, r#"v1="8""#, "vertex 8, but the file has 8"),
        (r#"v1="0""#, r#"v1="-1""#, "v1"),
        (r#"x="0""#, r#"x="NaN""#, "3D/part.model: vertex 0 has"),
        (r#"x="0""#, r#"x="1,5""#, "'1,5'"),
        (r#"x="0""#, "", "no x"),
        (r#"objectid="1""#, r#"objectid="7""#, "no object 7"),
        (r#"<item objectid="1"/>"#, "", "no item"),
        ("</vertices>", "", "part: 3D/part.model"),
        ("<model ", r#"<model requiredextensions="s" xmlns:s="urn:slices" "#, "urn:slices"),
        ("<model ", "<!DOCTYPE a [<!ENTITY b 'c'>]><model ", "document type"),
        (r#"<item objectid="1"/>"#, r#"<item objectid="1" transform="1 0 0"/>"#, "twelve"),
        (CORE, "urn:other", "core specification"),
    ] {
        let error = with(from, to);
        assert!(error.contains(expected), "{to}: {error}");
    }
    let circle = r#"<object id="1"><components><component objectid="1"/></components></object>"#;
    assert!(refusal(&archive(&model("", circle, r#"<item objectid="1"/>"#))).contains("circle"));
    // Sixty objects that each stand twice in the next.
    let doubling: String = (2..62)
        .map(|id| {
            let part = format!(r#"<component objectid="{}"/>"#, id - 1);
            format!(r#"<object id="{id}"><components>{part}{part}</components></object>"#)
        })
        .collect();
    let cube = mesh_text(&unit_cube());
    for (first, expected) in [(cube.as_str(), "100 for each of its bytes"), ("<components/>", "too many")] {
        let bomb = format!(r#"<object id="1">{first}</object>{doubling}"#);
        let error = refusal(&archive(&model("", &bomb, r#"<item objectid="61"/>"#)));
        assert!(error.contains(expected), "{error}");
    }
    // Ten megabytes of spaces.
    let spaces = whole.replace("<resources>", &format!("<resources>{}", " ".repeat(10_000_000)));
    assert!(refusal(&archive(&spaces)).contains("unfolds"));
    // What begins as an archive was cut short, and what does not never was one.
    for (bytes, cut) in [(b"PK\x03\x04".as_slice(), true), (b"solid of another kind", false)] {
        let error = refusal(bytes);
        assert!(error.contains("ZIP") && error.contains("cut short") == cut, "{error}");
    }
}
