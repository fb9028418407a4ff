//! Stock in process: how long a cutting segment of three voxels takes at 256³, beside making the voxels' sums anew after it.

use std::sync::Mutex;
use std::time::Instant;

use anyhow::Result;
use glam::DVec3;
use imf_core::check::{CheckBodies, CheckSettings, check_stock};
use imf_core::control::Control;
use imf_core::field::ExactField;
use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;
use imf_core::pose::Pose;
use imf_core::tool::Tool;
use imf_core::toolpath::{MoveKind, Toolpath};
use imf_core::unit::LengthUnit;
use serde::Serialize;

use super::{End, mill};
use crate::document::Document;
use crate::measurement::seconds;

/// Voxels along an edge of the stock, and their pitch in mm.
const VOXELS: usize = 256;
const PITCH: f64 = 0.5;
/// Length of a segment in mm.
const SEGMENT: f64 = 1.5;
/// How often the rival is measured.
const REBUILDS: usize = 5;

/// One path through the stock; times are in microseconds a segment that cuts.
#[derive(Serialize)]
pub(super) struct Row {
    path: &'static str,
    segments: usize,
    /// Voxels that go, on the average.
    voxels: f64,
    median: f64,
    percentile_99: f64,
    /// Sums and distances of all voxels, made anew for one pose.
    rebuild: f64,
}

/// On one thread.
pub(super) fn rows() -> Result<Vec<Row>> {
    // Of 10 mm with a shank as wide, 45 mm out of a holder of 40 mm.
    let mill = |end| mill(end, 5.0, 25.0, 45.0, [20.0, 50.0]);
    Ok(vec![
        row("pocket in layers, flat end", &mill(End::Flat), &pocket())?,
        row("pocket in layers, corner radius", &mill(End::Bull), &pocket())?,
        row("bowl on five axes, ball end", &mill(End::Ball), &bowl())?,
    ])
}

/// A row of points each `SEGMENT` from the next.
fn steps(from: f64, to: f64) -> impl Iterator<Item = f64> {
    let count = ((to - from).abs() / SEGMENT).ceil() as usize;
    (0..=count).map(move |step| from + (to - from) * step as f64 / count as f64)
}

/// 80 × 80 mm, 30 mm deep, in layers of 3 mm and rows of 4 mm.
fn pocket() -> Vec<(DVec3, DVec3)> {
    let mut path = Vec::new();
    for layer in 1..=10 {
        for row in 0..20 {
            let y = -38.0 + 4.0 * f64::from(row);
            let end = if row % 2 == 0 { 35.0 } else { -35.0 };
            let tip = |x: f64| DVec3::new(x, y, -3.0 * f64::from(layer));
            path.extend(steps(-end, end).map(|x| (tip(x), DVec3::Z)));
        }
        path.push((DVec3::new(35.0, 40.0, 2.0), DVec3::Z));
        path.push((DVec3::new(-35.0, -38.0, 2.0), DVec3::Z));
    }
    path
}

/// A bowl 12 mm deep in rows of 2 mm, the tool leaning by up to 25°.
fn bowl() -> Vec<(DVec3, DVec3)> {
    let mut path = Vec::new();
    for row in 0..40 {
        let y = -39.0 + 2.0 * f64::from(row);
        let end = if row % 2 == 0 { 40.0 } else { -40.0 };
        path.extend(steps(-end, end).map(|x| {
            let depth = 12.0 * (1.0 - (x * x + y * y) / 3200.0);
            let axis = DVec3::new(-x / 90.0, -y / 90.0, 1.0).normalize();
            (DVec3::new(x, y, -depth), axis)
        }));
    }
    path
}

fn row(path: &'static str, tool: &Tool, points: &[(DVec3, DVec3)]) -> Result<Row> {
    let size = VOXELS as f64 * PITCH;
    let grid = Grid { origin: DVec3::new(-0.5 * size, -0.5 * size, -size), pitch: PITCH, dims: [VOXELS; 3] };
    let stock = Occupancy { grid, solid: vec![1; grid.len()] };
    // The part is what lies 30 mm below the top.
    let part = |index: usize| u8::from(grid.centre(grid.voxel(index)).z < -30.0);
    let part = Occupancy { grid, solid: (0..grid.len()).map(part).collect() };
    let mut text = String::from("x,y,z,i,j,k\n");
    let high = points[0].0 + DVec3::Z * 50.0;
    for (tip, axis) in std::iter::once(&(high, DVec3::Z)).chain(points) {
        text += &format!("{},{},{},{},{},{}\n", tip.x, tip.y, tip.z, axis.x, axis.y, axis.z);
    }
    let toolpath = Toolpath::parse(&text, LengthUnit::Mm, "path.csv")?;
    let bodies = CheckBodies::of_part(&part);
    let settings = CheckSettings::of_pitch(PITCH, LengthUnit::Mm);
    let times = Mutex::new(vec![Instant::now()]);
    let progress = |_| {
        if let Ok(mut times) = times.lock() {
            times.push(Instant::now());
        }
    };
    let control = Control { progress: &progress, ..Control::quiet() };
    let report = check_stock(bodies, &stock, &[(None, tool)], &toolpath, &settings, control)?;
    let times = times.into_inner().unwrap_or_default();
    let spent = times.windows(2).map(|pair| (pair[1] - pair[0]).as_secs_f64() * 1e6);
    let cutting = spent.zip(&report.removed).skip(1);
    let cutting = cutting.filter(|(_, line)| line.kind == MoveKind::Feed && line.voxels > 0);
    let (mut spent, voxels): (Vec<f64>, Vec<u64>) = cutting.map(|(spent, line)| (spent, line.voxels)).unzip();
    spent.sort_by(f64::total_cmp);
    let (mut anew, pose) = (Vec::new(), Pose::along(DVec3::new(0.0, 0.0, 5.0), DVec3::Z));
    for _ in 0..REBUILDS {
        let solid = report.remaining.clone();
        anew.push(seconds(|| Ok(ExactField::new(solid, tool)?.collides(&pose)))?.0 * 1e6);
    }
    anew.sort_by(f64::total_cmp);
    let at = |share: f64| spent[((spent.len() - 1) as f64 * share) as usize];
    Ok(Row {
        path,
        segments: spent.len(),
        voxels: voxels.iter().sum::<u64>() as f64 / spent.len() as f64,
        median: at(0.5),
        percentile_99: at(0.99),
        rebuild: anew[REBUILDS / 2],
    })
}

/// The table of all rows.
pub(super) fn tell(rows: &[Row], document: &mut Document) {
    document.section("Stock in process");
    document.paragraph(format!(
        "{VOXELS}³ voxels of {PITCH} mm, a mill of 10 mm with a shank as wide, 45 mm out of a holder of 40 mm; segments of {SEGMENT} mm \
         that cut, on one thread. Beside them the sums and distances of all voxels made anew, as often as the stock changes."
    ));
    let cells = rows.iter().map(|row| {
        vec![
            row.path.to_owned(),
            row.segments.to_string(),
            format!("{:.0}", row.voxels),
            format!("{:.0}", row.median),
            format!("{:.0}", row.percentile_99),
            format!("{:.0}", row.rebuild),
        ]
    });
    document.table(
        &["path", "segments", "voxels each", "median, µs", "99 %, µs", "made anew, µs"],
        cells.collect(),
    );
}
