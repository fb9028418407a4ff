//! The picture of how training went.

use imf_fields::model::TrainingRecord;
use imf_fields::recipe::Loss;

use crate::picture::{AxisScale, Chart, Series};

/// The loss in training and at poses held out of it, in one unit. The two differ also because training draws three
/// quarters of its samples where the tool collides, and held-out poses lie anywhere.
pub(crate) fn loss_chart(record: &TrainingRecord) -> Chart {
    let training = record.losses.iter().map(|p| (p.step as f64, p.loss)).collect();
    let mut series = vec![Series { name: "training samples".into(), points: training, markers: false }];
    if let Some(held_out) = &record.held_out {
        let errors = held_out.errors.iter();
        let (name, points) = match record.plan.loss {
            Loss::L1 | Loss::L1Small => {
                ("held out, anywhere (MAE)", errors.map(|e| (e.step as f64, e.mae)).collect())
            }
            Loss::L2 => ("held out, anywhere (MSE)", errors.map(|e| (e.step as f64, e.mse)).collect()),
        };
        series.push(Series { name: name.into(), points, markers: false });
    }
    Chart {
        title: format!("Training loss, {} samples", record.samples),
        x_name: "steps".into(),
        x_scale: AxisScale::Linear,
        value_name: "mean loss".into(),
        value_scale: AxisScale::Logarithmic,
        series,
    }
}
