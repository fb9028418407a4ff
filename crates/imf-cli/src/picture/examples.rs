//! Pictures of made-up fields with everything in them, for the eye: set `IMF_EXAMPLE_PICTURES` to a folder and run
//! `cargo test -p imf-cli example` to look at them. Without it they go to a folder that is removed again.

use std::path::PathBuf;

use ndarray::{Array2, Array3, Axis};

use super::*;

/// A soft ball on a soft slab: 29×38×61 voxels like the demonstration's, values up to about 0.4.
fn field(sharpness: f32) -> Array3<f32> {
    Array3::from_shape_fn((29, 38, 61), |(x, y, z)| {
        let [x, y, z] = [x as f32 - 14.0, y as f32 - 18.0, z as f32 - 26.0];
        let ball = 1.0 / (1.0 + (((x * x + y * y + z * z).sqrt() - 9.0) * sharpness).exp());
        let slab = 1.0 / (1.0 + ((z + 18.0 + 0.2 * x) * sharpness).exp());
        0.4 * (1.0 - (1.0 - ball) * (1.0 - slab))
    })
}

fn part() -> Array3<u8> {
    field(2.0).mapv(|value| u8::from(value > 0.3))
}

fn axes(first: &str, second: &str) -> Axes {
    Axes { names: [first.into(), second.into()], unit: "mm".into(), start: [-21.75, -20.0], pitch: 1.5 }
}

fn folder(removed: &tempfile::TempDir) -> PathBuf {
    std::env::var_os("IMF_EXAMPLE_PICTURES").map_or_else(|| removed.path().to_owned(), PathBuf::from)
}

#[test]
fn example_comparison() {
    let (exact, part) = (field(0.5), part());
    let learnt = [0.46f32, 0.58].map(field);
    let differences: Vec<Array3<f32>> = learnt.iter().map(|learnt| learnt - &exact).collect();
    fn middle<T>(field: &Array3<T>) -> ndarray::ArrayView2<'_, T> {
        field.index_axis(Axis(1), 19)
    }

    let measure = Scale::measure_of(&[middle(&exact), middle(&learnt[0])], "collision measure CMF");
    let slices: Vec<_> = differences.iter().map(middle).collect();
    let difference = Scale::difference_of(&slices, "learnt − exact");
    let panel = |title: &str, values, scale: &Scale| Panel {
        title: title.into(),
        values,
        mask: Some(Mask { voxels: middle(&part), style: MaskStyle::Outline }),
        scale: scale.clone(),
        axes: axes("x", "z"),
    };
    let rows = learnt.iter().zip(&differences).zip(["θ = 24.0°, φ = 36.0°", "θ = 211.3°, φ = 107.9°"]);
    let rows = rows.map(|((learnt, wrong), title)| PanelRow {
        title: title.into(),
        panels: vec![
            panel("exact section", middle(&exact), &measure),
            panel("learnt section", middle(learnt), &measure),
            panel("difference", middle(wrong), &difference),
        ],
    });
    let sheet = PanelSheet {
        title: "Teapot, tool `paper`: sections that training never saw".into(),
        rows: rows.collect(),
        notes: vec!["y = 8.5 mm; outline: the part".into()],
        pixels_per_voxel: None,
    };
    let removed = tempfile::tempdir().unwrap();
    let tally = sheet.save(&folder(&removed).join("comparison.png")).unwrap();
    assert_eq!(tally.not_finite, 0);
}

#[test]
fn example_slices() {
    let mut values = field(0.5);
    values.slice_mut(ndarray::s![3..6, 19, 40..44]).fill(f32::NAN);
    let part = part();
    let scale = Scale::measure(0.2, "inaccessibility measure IMF");
    let panel = |title: &str, axis: usize, at: usize, names: (&str, &str)| Panel {
        title: title.into(),
        values: values.index_axis(Axis(axis), at),
        mask: Some(Mask { voxels: part.index_axis(Axis(axis), at), style: MaskStyle::Fill }),
        scale: scale.clone(),
        axes: axes(names.0, names.1),
    };
    let panels = vec![
        panel("y = 8.5 mm", 1, 19, ("x", "z")),
        panel("x = 0 mm", 0, 14, ("y", "z")),
        panel("z = 20 mm", 2, 26, ("x", "y")),
    ];
    let sheet = PanelSheet {
        title: "IMF over 225 orientations".into(),
        rows: vec![PanelRow { title: String::new(), panels }],
        notes: vec!["grey: the part".into()],
        pixels_per_voxel: Some(7),
    };
    let removed = tempfile::tempdir().unwrap();
    let tally = sheet.save(&folder(&removed).join("slices.png")).unwrap();
    assert_eq!(tally.not_finite, 12);
    assert!(tally.out_of_range > 0);
}

#[test]
fn example_curves() {
    // A repeatable roughness that looks like noise.
    let rough = |step: usize| 1.0 + 0.12 * ((step * step) as f64 * 0.7).sin();
    let loss = |step: usize| (0.002 + 0.12 * (-(step as f64) / 60.0).exp()) * rough(step);
    let training = (0..400).map(|step| (step as f64 * 0.0125, loss(step))).collect();
    let unseen = (0..9).map(|epoch| (epoch as f64 * 0.6, 1.3 * loss(epoch * 48))).collect();
    let chart = Chart {
        title: "Training of the sine network".into(),
        x_name: "samples seen [millions]".into(),
        x_scale: AxisScale::Linear,
        value_name: "mean absolute error".into(),
        value_scale: AxisScale::Logarithmic,
        series: vec![
            Series { name: "training loss".into(), points: training, markers: false },
            Series { name: "unseen directions".into(), points: unseen, markers: true },
        ],
    };
    let removed = tempfile::tempdir().unwrap();
    assert_eq!(chart.save(&folder(&removed).join("loss.png")).unwrap(), Tally::default());
}

#[test]
fn example_bars() {
    let bar = |name: &str, value, marked| Bar { name: name.into(), value, marked };
    let chart = BarChart {
        title: "Error at 64 random directions that training never saw".into(),
        value_name: "mean squared error".into(),
        scale: AxisScale::Logarithmic,
        bars: vec![
            bar("learnt field", 4.21e-5, true),
            bar("nearest trained section", 6.3e-4, false),
            bar("variance of the exact field", 9.87e-3, false),
        ],
    };
    let removed = tempfile::tempdir().unwrap();
    assert_eq!(chart.save(&folder(&removed).join("errors.png")).unwrap(), Tally::default());
}

#[test]
fn example_of_a_tiny_slice() {
    let values = Array2::from_shape_fn((2, 3), |(x, y)| (x + y) as f32 / 4.0);
    let panel = Panel {
        title: "2×3 voxels".into(),
        values: values.view(),
        mask: None,
        scale: Scale::measure(1.0, "collision measure CMF"),
        axes: axes("x", "y"),
    };
    let rows = vec![PanelRow { title: String::new(), panels: vec![panel] }];
    let sheet = PanelSheet { title: String::new(), rows, notes: vec![], pixels_per_voxel: None };
    let removed = tempfile::tempdir().unwrap();
    sheet.save(&folder(&removed).join("tiny.png")).unwrap();
}
