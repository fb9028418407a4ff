//! Fields and their rivals at random poses.

use imf_core::control::Control;
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneSpec;
use imf_core::tool::Tool;
use imf_fields::harmonic::FitSettings;
use imf_fields::harmonic::file::HarmonicFile;

use crate::binary::Workdir;

/// A small field of the teapot that is not calibrated.
fn field() -> HarmonicFile {
    let (part, tool) = (ReferencePart::Teapot, Tool::paper());
    let scene = SceneSpec::of_reference(part, &part.mesh(), [15, 19, 31], &tool).scene().unwrap();
    let settings = FitSettings { degree: 4, sections_per_function: 4.0, ..FitSettings::default() };
    HarmonicFile::fit(&scene, &settings, Control::quiet()).unwrap()
}

#[test]
fn a_field_that_is_not_calibrated_is_asked_for_poses_and_not_for_decisions() {
    let work = Workdir::new();
    field().write(&work.path("field.safetensors")).unwrap();
    let bench = "query field.safetensors --poses 50 --rival-poses 5 --python no-such --parry3d no-such";
    let report = work.json(&format!("{bench} --out out"));
    let rows = report["rows"].as_array().unwrap();
    let row = rows.iter().find(|row| row["answers"].as_str().unwrap().contains("calibrat")).unwrap();
    assert_eq!(row["answers"], "not calibrated (imf calibrate)");
    assert!(row["free"].is_null() && row["colliding"].is_null() && row["agree"].is_null(), "{row}");
    assert!(row["poses_per_second"].as_f64().unwrap() > 0.0, "{row}");
    let calls: Vec<u64> = rows.iter().map(|row| row["batch"].as_u64().unwrap()).collect();
    assert!(calls.contains(&1) && calls.contains(&50), "{calls:?}");
}
