//! Transfer, sparsity and architecture: the recipes that exist, beside the paper's numbers.

use anyhow::{Context as _, Result};
use imf_cli::progress::show_seconds;

use super::questions::Questions;
use super::table::{Row, Table};
use super::{Bench, published};
use crate::arguments::paper::PaperPart;
use crate::recipe::Recipe;

/// From bracket-raw to bracket, and as many epochs from random weights.
pub(super) fn transfer(bench: &Bench<'_>) -> Result<Table> {
    let mut table = Table::of_errors("transfer", "Transfer to a changed part", &["start", "compared"]);
    let recipe = bench.protocol.recipe("transfer", None)?;
    let run = bench.run("transfer", &recipe)?;
    let run = match run {
        Ok(run) => run,
        Err(diverged) => {
            table.notes.push(format!("No result. {diverged}"));
            return Ok(table);
        }
    };
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
    sweep(bench, "sparsity", PaperPart::Teapot, table)
}

/// The screw gear by smaller and larger networks.
pub(super) fn architecture(bench: &Bench<'_>) -> Result<Table> {
    let mut table = Table::of_errors("architecture", "Architecture", &["network", "compared"]);
    table.notes.push(
        "Our screw gear by `single` with other networks. In the paper 5×1024 did not converge in 50 epochs; the labels of \
         MSE and MPE are swapped in its table."
            .into(),
    );
    sweep(bench, "architecture", PaperPart::ScrewGear, table)
}

/// True where both train the same network on the same samples and ask it the same, whatever they are called.
fn same_training(one: &toml::Table, other: &toml::Table) -> Result<bool> {
    let read = |table: &toml::Table| -> Result<Recipe> {
        let recipe = Recipe::from_table(table.clone())?;
        Ok(Recipe { name: String::new(), about: String::new(), variants: Vec::new(), ..recipe })
    };
    Ok(read(one)? == read(other)?)
}

fn sweep(bench: &Bench<'_>, name: &str, part: PaperPart, mut table: Table) -> Result<Table> {
    let questions = Questions::of(&bench.protocol.settings(name)?.evaluation)?;
    for variant in bench.protocol.sweep(name)? {
        // One of the variants may be the training of the table of the parts.
        let run = if same_training(&variant.table, &bench.protocol.recipe("single", Some(part.name()))?)? {
            bench.trained(part, "single")?
        } else {
            bench.run(&format!("{name}-{}", variant.name), &variant.table)?
        };
        let papers = published::sweep(variant.name);
        // Named as at this scale, and by what stands there in the paper.
        let same = variant.about.replace('×', "x") == variant.name || name == "sparsity";
        let label = if same {
            variant.about
        } else {
            format!("{} (for {})", variant.about, variant.name.replace('x', "×"))
        };
        // Two sections stand before the two IMFs.
        let paper = |index: usize| papers.and_then(|papers| papers.get(index.checked_sub(2)?).copied());
        let run = match run {
            Ok(run) => run,
            Err(diverged) => {
                let rows = questions.names().into_iter().enumerate();
                let rows = rows.map(|(index, asked)| Row::diverged(vec![label.clone(), asked], paper(index)));
                table.rows.extend(rows);
                table.notes.push(format!("{label}: no result. {diverged}"));
                continue;
            }
        };
        let outcome = run.summary.results.first().context("a recipe without results")?;
        let answers = questions.names().into_iter().zip(questions.answers(outcome)?);
        for (index, (question, errors)) in answers.enumerate() {
            table.rows.push(Row::errors(vec![label.clone(), question], paper(index), &errors));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::paper::PaperScale;
    use crate::paper::protocol::Protocol;

    #[test]
    fn a_variant_that_single_is_already_is_not_trained_again() {
        for (scale, again) in
            [(PaperScale::Full, true), (PaperScale::Reduced, true), (PaperScale::Tiny, false)]
        {
            let protocol = Protocol::new(scale);
            for (name, part, same) in
                [("sparsity", "teapot", "35-percent"), ("architecture", "screw-gear", "5x512")]
            {
                let single = protocol.recipe("single", Some(part)).unwrap();
                for variant in protocol.sweep(name).unwrap() {
                    let expected = again && variant.name == same;
                    assert_eq!(same_training(&variant.table, &single).unwrap(), expected, "{}", variant.name);
                }
            }
        }
    }
}
