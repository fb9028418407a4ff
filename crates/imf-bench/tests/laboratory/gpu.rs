//! What a GPU does beside the CPU, on the machine's adapter; `IMF_NO_GPU_TESTS=1` leaves it out.
#![cfg(unix)]

use crate::binary::{Workdir, device};

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn what_an_adapter_does_is_measured_beside_the_cpu() {
    let work = Workdir::with_adapters();
    let bench = format!("gpu --small --device {} --python none --out out --json", device());
    let report = work.imf(&bench).done().json();
    let parts = report.as_array().unwrap();
    assert_eq!(parts.len(), 5, "{report}");
    assert!(parts.iter().all(|part| part["failed"].is_null()), "{report}");
    let found = |part: usize| &parts[part]["found"];
    let peak = found(0)["flops_per_second"].as_f64().unwrap();
    assert!(found(1)["rows"].as_array().unwrap().iter().all(|row| row["equal"] == true), "{report}");
    for training in [2, 3] {
        let share = found(training)["rows"][0]["share"].as_f64().unwrap();
        assert!(peak > 1e8 && (0.0..1.0).contains(&share), "{share} of {peak}");
    }
    let field = found(4);
    let rows = field["rows"].as_array().unwrap();
    // The harmonic field's IMF, sections, the IMF, values, gradients; of two fields that were distilled there is no difference to tell.
    let differences: Vec<f64> = rows.iter().filter_map(|row| row["largest_difference"].as_f64()).collect();
    assert!(differences.len() == 5 && differences.iter().all(|&most| most < 1e-4), "{report}");
    let [on_gpu, on_cpu] = [0, 1].map(|by| field["judged"][by]["errors"]["mse"].as_f64().unwrap());
    assert!((0.5..2.0).contains(&(on_gpu / on_cpu)), "{on_gpu} on the adapter, {on_cpu} on the CPU");

    // One part anew: the others stay.
    let files = ["peak", "sections", "field"].map(|part| format!("out/{part}.json"));
    let before = files.each_ref().map(|file| work.text(file));
    work.imf(&format!("{bench} --only sections")).done();
    let after = files.each_ref().map(|file| work.text(file));
    assert!(after[0] == before[0] && after[2] == before[2] && after[1] != before[1]);
    assert!(work.text("out/sections.md").contains("# sections"));
    assert!(work.text("out/field.md").contains("IMF over fibonacci:37"));

    // A part that fails leaves what an earlier run found of it.
    work.imf(&format!("{bench} --only field --memory 100KiB")).refused(&[
        "not measured whole",
        "field",
        "memory",
    ]);
    assert_eq!(work.text("out/field.json"), before[2]);

    // A folder where a file has to be written.
    std::fs::remove_file(work.path("out/peak.md")).unwrap();
    std::fs::create_dir(work.path("out/peak.md")).unwrap();
    work.imf(&format!("{bench} --only peak")).refused(&["peak.md"]);
    work.imf("gpu --device cpu --out none").refused(&["measures a GPU", "--device cpu"]);
    assert!(!work.path("none").exists());
}
