//! Training on the machine's adapter through the command; `IMF_NO_GPU_TESTS=1` leaves it out.
#![cfg(unix)]

use imf_fields::recipe::Precision;
use imf_gpu::adapters;

use crate::binary::{DATASET, TRAIN, Workdir, device};
use crate::saved::HARMONIC;

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn a_training_on_the_adapter_resumes_to_the_same_bits_and_evaluates_as_on_the_cpu() {
    let work = Workdir::with_adapters();
    work.imf(DATASET).done();
    let on_adapter = format!("--device {}", device());
    let train = TRAIN.replace("--device cpu", &on_adapter).replace("--batch 256", "--batch 64");
    let train = format!("{train} --steps 400 --set schedule=cosine");
    let whole = work.imf(&format!("{train} --out whole --json")).done();
    let name = adapters().into_iter().map(|adapter| adapter.name);
    let engine = whole.json()["engine"].as_str().unwrap().to_owned();
    assert!(name.into_iter().any(|name| engine.contains(&name)), "{engine}");

    work.imf(&format!("{train} --set precision=bf16 --out none")).refused(&[
        "bf16",
        "on CPUs alone",
        "train there",
    ]);

    work.imf(&format!("{train} --set precision=f16 --out half")).done();
    let half = work.model("half/field.safetensors");
    assert_eq!(half.record.plan.precision, Precision::F16);
    let plain = work.model("whole/field.safetensors");
    assert!(half.state != plain.state, "nothing was rounded");
    let [half, plain] = [half, plain].map(|model| model.record.losses.last().unwrap().loss);
    // Chance parts two trainings of 400 steps by some percent.
    assert!(half < 1.25 * plain, "{half} in f16, {plain} in f32");

    let checkpoint = "broken/checkpoint.safetensors";
    work.interrupted_after(5, &format!("{train} --out broken --set checkpoint_every=0.02")).interrupted(&[
        "is saved in",
        checkpoint,
        "--resume",
    ]);
    let saved = work.model(checkpoint);
    assert!((1..400).contains(&saved.record.steps), "{}", saved.record.steps);
    work.imf(&format!("{train} --out broken --resume")).done();
    for file in ["field.safetensors", "checkpoint.safetensors"] {
        let [whole, broken] = ["whole", "broken"].map(|folder| work.model(&format!("{folder}/{file}")).state);
        assert!(whole == broken, "{file}: the pieces ended elsewhere");
    }

    work.calibrate_quickly("whole/field.safetensors");
    let eval = |device: &str| {
        let line =
            format!("eval whole/field.safetensors --random 3 --imf fibonacci:4 --json --device {device}");
        work.imf(&line).done().json()
    };
    let (gpu, cpu) = (eval(device()), eval("cpu"));
    for (gpu, cpu) in gpu["rows"].as_array().unwrap().iter().zip(cpu["rows"].as_array().unwrap()) {
        // Values differ by some 1e-6, and a mean of absolute errors by no more.
        let [gpu, cpu] = [gpu, cpu].map(|row| row["mae"].as_f64().unwrap());
        assert!((gpu - cpu).abs() < 1e-5, "{gpu} {cpu}");
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn a_harmonic_field_is_distilled_on_the_adapter_and_goes_on_there() {
    let work = Workdir::with_adapters();
    work.imf(HARMONIC).done();
    let small = "train factored field.safetensors --network 2x32 --set batch=128 --steps 200 --rate 4e-3 --no-calibrate --json";
    let there = format!("{small} --device {}", device());
    // SOAP, which is what an adapter does by itself, as the CPU; and Adam for every weight.
    for (optimiser, asked) in [("", ""), ("-adam", " --set optimiser=adam")] {
        let (there, small) = (format!("{there}{asked}"), format!("{small}{asked}"));
        let [whole, often, cpu] = ["whole", "often", "cpu"].map(|name| format!("{name}{optimiser}"));
        let report = work.imf(&format!("{there} --out {whole}")).done().json();
        let on_cpu = work.imf(&format!("{small} --out {cpu}")).done().json();
        let [found, expected] = [report, on_cpu].map(|report| report["loss"].as_f64().unwrap());
        // Roundings part the two a little more with every step.
        assert!((found / expected - 1.0).abs() < 0.1, "{found} and {expected}");
        // A checkpoint after every report is as many stops and goes.
        work.imf(&format!("{there} --out {often} --set checkpoint_every=0")).done();
        let field = |folder: &str| work.bytes(&format!("{folder}/field.safetensors"));
        assert!(field(&whole) == field(&often));
        std::fs::remove_file(work.path(&format!("{often}/field.safetensors"))).unwrap();
        work.imf(&format!("{there} --out {often} --resume")).done();
        assert!(field(&whole) == field(&often));
    }
    // What one engine made, the other takes for its own.
    work.imf(&format!("{there} --out cpu --resume")).done();
    work.imf(&format!("{small} --out whole --resume")).done();
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn harmonic_and_factored_fields_are_evaluated_and_queried_on_the_adapter_as_on_the_cpu() {
    let work = Workdir::with_adapters();
    let on_adapter = format!("--device {}", device());
    work.imf(HARMONIC).done();
    work.imf("train factored field.safetensors --network 2x32 --steps 50 --no-calibrate --out factored")
        .done();
    let field = "field field.safetensors --orientations fibonacci:20";
    work.imf(&format!("{field} --out sections")).done();

    // Sections and minima by the same harmonics.
    work.imf(&format!("{field} --out there {on_adapter}")).done();
    work.imf(&format!("{field} --imf --out least")).done();
    let told = work.imf(&format!("{field} --imf --out least-there {on_adapter}")).done();
    let name = adapters().into_iter().map(|adapter| adapter.name);
    assert!(name.into_iter().any(|name| told.stderr.contains(&name)), "{}", told.stderr);
    let values = |file: &str| work.npy::<f32>(file);
    for (here, there) in
        [("sections/cmf-00019.npy", "there/cmf-00019.npy"), ("least/imf.npy", "least-there/imf.npy")]
    {
        let (here, there) = (values(here), values(there));
        assert_eq!(here.shape(), there.shape());
        // Sums of 25 products in another order.
        assert!(here.iter().zip(&there).all(|(a, b)| (a - b).abs() < 1e-5));
        assert!(here.iter().any(|&value| value > 0.02));
    }

    let rows = |file: &str, device: &str| -> Vec<(f64, f64)> {
        let report =
            work.imf(&format!("eval {file} --random 3 --imf fibonacci:4 --json {device}")).done().json();
        let engine = report["evaluation_engine"].as_str().unwrap().to_owned();
        assert_eq!(engine.starts_with("CPU,"), device.is_empty(), "{engine}");
        let row = |row: &serde_json::Value| (row["mae"].as_f64().unwrap(), row["mpe"].as_f64().unwrap());
        report["rows"].as_array().unwrap().iter().map(row).collect()
    };
    let poses = "x,y,z,theta,phi\n5,0,5,10,20\n3,-2,8,200,120\n6,1,1,0,0\n9e9,0,0,10,20\n";
    work.write("poses.csv", poses);
    let answers = |file: &str, device: &str| -> Vec<f64> {
        let run = work.imf(&format!("query {file} poses.csv --exact --json {device}")).done();
        run.warns(&["1 of 4 poses lie outside the box"]);
        let answers = run.json();
        answers.as_array().unwrap().iter().map(|row| row["overlap"].as_f64().unwrap()).collect()
    };
    for file in ["field.safetensors", "factored/field.safetensors"] {
        let sections = format!("field {file} --orientations fibonacci:9 --imf");
        work.imf(&format!("{sections} --out kept")).done();
        work.imf(&format!("{sections} --out kept-there {on_adapter}")).done();
        let (here, there) = (values("kept/imf.npy"), values("kept-there/imf.npy"));
        assert!(here.iter().zip(&there).all(|(a, b)| (a - b).abs() < 1e-5));
        work.calibrate_quickly(file);
        for (there, here) in rows(file, &on_adapter).into_iter().zip(rows(file, "")) {
            assert!((there.0 - here.0).abs() < 1e-5 && (there.1 - here.1).abs() < 1e-5, "{there:?} {here:?}");
        }
        let (there, here) = (answers(file, &on_adapter), answers(file, ""));
        assert!(there.iter().zip(&here).all(|(a, b)| (a - b).abs() < 1e-5), "{there:?} {here:?}");
    }
    if device() == "software" {
        let query = format!("query field.safetensors poses.csv {on_adapter} --memory 900KiB");
        work.imf(&query).refused(&["coefficients at every voxel", "--device cpu", "--memory"]);
    }
}
