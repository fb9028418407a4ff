//! The picture of how training went.

use imf_core::model::TrainingRecord;

use crate::picture::{AxisScale, Chart, Series};

/// The loss curve.
pub(crate) fn loss_chart(record: &TrainingRecord) -> Chart {
    Chart {
        title: format!("Training loss, {} samples", record.samples),
        x_name: "steps".into(),
        value_name: "mean loss".into(),
        value_scale: AxisScale::Logarithmic,
        series: vec![Series {
            name: "training".into(),
            points: record.losses.iter().map(|p| (p.step as f64, p.loss)).collect(),
            markers: false,
        }],
    }
}
