//! Transfer, sparsity and architecture: the regimes that exist, beside the paper's numbers.

use anyhow::{Context as _, Result};

use super::questions::Questions;
use super::table::{Row, Table};
use super::{Bench, published};
use crate::progress::show_seconds;

/// From bracket-raw to bracket, and as many epochs from random weights.
pub(super) fn transfer(bench: &Bench<'_>) -> Result<Table> {
    let mut table = Table::of_errors("transfer", "Transfer to a changed part", &["start", "compared"]);
    let regime = bench.protocol.regime("transfer", None)?;
    let run = bench.run("transfer", &regime)?;
    let questions = Questions::of(&bench.protocol.settings("transfer")?.evaluation)?;
    table.notes.push(
        "Our bracket and its design domain, in the style of the paper's: fine-tuned from the network of the design domain, \
         and trained as long from random weights. The paper has the IMF over 225 alone."
            .into(),
    );
    for (stage, label) in [("adapted", "fine-tuned"), ("control", "random weights")] {
        let outcome = run.summary.results.iter().find(|outcome| outcome.stage == stage);
        let outcome = outcome.with_context(|| format!("transfer has no result {stage}"))?;
        let answers = questions.names().into_iter().zip(questions.answers(outcome)?);
        for (index, (question, errors)) in answers.enumerate() {
            // Two sections stand before the IMF over 225.
            let paper = published::transfer(stage).filter(|_| index == 2);
            table.rows.push(Row::errors(vec![label.into(), question], paper, &errors));
        }
    }
    for stage in &run.summary.stages {
        table.notes.push(format!(
            "{}: {} steps in {}.",
            stage.name,
            stage.steps,
            show_seconds(stage.seconds)
        ));
    }
    Ok(table)
}

/// The teapot from fewer and more samples.
pub(super) fn sparsity(bench: &Bench<'_>) -> Result<Table> {
    let mut table = Table::of_errors("sparsity", "Sparsity of the data", &["samples", "compared"]);
    table.notes.push(
        "The teapot by `single` at several densities. The paper has no 35 % here; the labels of MSE and MPE are swapped in \
         its table."
            .into(),
    );
    sweep(bench, "sparsity", table)
}

/// The screw gear by smaller and larger networks.
pub(super) fn architecture(bench: &Bench<'_>) -> Result<Table> {
    let mut table = Table::of_errors("architecture", "Architecture", &["network", "compared"]);
    table.notes.push(
        "Our screw gear by `single` with other networks. In the paper 5×1024 did not converge in 50 epochs; the labels of \
         MSE and MPE are swapped in its table."
            .into(),
    );
    sweep(bench, "architecture", table)
}

fn sweep(bench: &Bench<'_>, name: &str, mut table: Table) -> Result<Table> {
    let questions = Questions::of(&bench.protocol.settings(name)?.evaluation)?;
    for variant in bench.protocol.sweep(name)? {
        let run = bench.run(&format!("{name}-{}", variant.name), &variant.table)?;
        let outcome = run.summary.results.first().context("a regime without results")?;
        let papers = published::sweep(variant.name);
        // Named as at this scale, and by what stands there in the paper.
        let same = variant.about.replace('×', "x") == variant.name || name == "sparsity";
        let label = if same {
            variant.about
        } else {
            format!("{} (for {})", variant.about, variant.name.replace('x', "×"))
        };
        let answers = questions.names().into_iter().zip(questions.answers(outcome)?);
        for (index, (question, errors)) in answers.enumerate() {
            // Two sections stand before the two IMFs.
            let paper = papers.and_then(|papers| papers.get(index.wrapping_sub(2)).copied());
            table.rows.push(Row::errors(vec![label.clone(), question], paper, &errors));
        }
        table.notes.push(format!(
            "{label}: {} parameters, {} steps in {}.",
            outcome.parameters,
            run.summary.stages.iter().map(|stage| stage.steps).sum::<u64>(),
            show_seconds(run.summary.seconds())
        ));
    }
    Ok(table)
}
