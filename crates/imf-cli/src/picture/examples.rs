//! Pictures of made-up fields with everything in them, for the eye: set `IMF_EXAMPLE_PICTURES` to a folder and run
//! `cargo test -p imf-cli example` to look at them. Without it they go to a folder that is removed again.

use ndarray::{Array3, Axis, s};

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

#[test]
fn examples_of_all_pictures() {
    let removed = tempfile::tempdir().unwrap();
    let folder =
        std::env::var_os("IMF_EXAMPLE_PICTURES").map_or_else(|| removed.path().to_owned(), Into::into);
    let mut exact = field(0.5);
    exact.slice_mut(s![3..6, 19, 40..44]).fill(f32::NAN);
    let difference = field(0.46) - &exact;
    let part = field(2.0).mapv(|value| u8::from(value > 0.3));
    let measure = Scale::measure(0.3, "collision measure CMF");
    let signed = Scale::difference_of(&[difference.index_axis(Axis(1), 19)], "learnt − exact");
    let axes =
        Axes { names: ["x".into(), "z".into()], unit: "mm".into(), start: [-21.75, -20.0], pitch: 1.5 };
    for (name, axis, style) in [("outlined.png", 1, MaskStyle::Outline), ("filled.png", 2, MaskStyle::Fill)] {
        let rows = [("exact", &exact, &measure), ("difference", &difference, &signed)];
        let rows = rows.map(|(title, values, scale)| PanelRow {
            title: format!("{title} at θ = 24.0°, φ = 36.0°"),
            panels: ["one plane", "another plane"]
                .into_iter()
                .map(|title| Panel {
                    title: title.into(),
                    values: values.index_axis(Axis(axis), 19),
                    mask: Some(Mask { voxels: part.index_axis(Axis(axis), 19), style }),
                    scale: scale.clone(),
                    axes: axes.clone(),
                })
                .collect(),
        });
        let sheet = PanelSheet {
            title: "Teapot, tool `paper`: sections at two orientations that training never saw".into(),
            rows: rows.into(),
            notes: vec![
                "y = 8.5 mm; outline: the part; and a note that needs more than one line here".into(),
            ],
            pixels_per_voxel: (axis == 2).then_some(7),
        };
        sheet.save(&folder.join(name)).unwrap();
    }

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
    chart.save(&folder.join("loss.png")).unwrap();
    let bar = |name: &str, value, marked| Bar { name: name.into(), value, marked };
    let chart = BarChart {
        title: "Error at 64 random directions that training never saw".into(),
        value_name: "mean squared error".into(),
        bars: vec![
            bar("learnt field", 4.21e-5, true),
            bar("nearest trained section", 6.3e-4, false),
            bar("variance of the exact field", 9.87e-3, false),
        ],
    };
    chart.save(&folder.join("errors.png")).unwrap();
}
