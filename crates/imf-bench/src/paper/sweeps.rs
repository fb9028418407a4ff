//! Transfer, sparsity and architecture: the recipes that exist, beside the paper's numbers.

use anyhow::{Context as _, Result};
use imf_core::parts::ReferencePart;

use super::Bench;
use super::published::PAPER;
use super::table::Table;
use crate::recipe::{EvaluationSets, Recipe, Source};

/// From bracket-raw to bracket, and as many epochs from random weights.
pub(super) fn transfer(bench: &Bench<'_>) -> Result<Table> {
    let mut table = Table::of_errors("transfer", "Transfer to a changed part", &["start", "compared"]);
    let source = bench.protocol.recipe("transfer", None)?;
    let recipe = source.recipe()?;
    let training = bench.run("transfer", &source)?;
    table.notes.push(
        "Our bracket and its design domain, in the style of the paper's: fine-tuned from the network of the design domain, \
         and trained as long from random weights. The paper has the IMF over 225 alone. Steps and times are of \
         the stage alone: the network of the design domain was made before."
            .into(),
    );
    for (stage, label) in [("adapted", "fine-tuned"), ("control", "random weights")] {
        // Two sections stand before the IMF over 225.
        let paper = |index| PAPER.transfer.get(stage).filter(|_| index == 2).copied();
        let seconds = PAPER.transfer_seconds.get(stage).copied();
        let own = recipe.results().find(|own| own.name == stage).context("transfer lacks a stage")?;
        let evaluation_sets = EvaluationSets::of_result(&recipe, own)?;
        table.add_training(&[label], (&training, Some(stage)), &evaluation_sets, paper, seconds)?;
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
    let label = |_: &str, recipe: &Recipe| format!("{:.0} %", 100.0 * recipe.stages[0].sampling.density);
    sweep(bench, "sparsity", ReferencePart::Teapot, label, table)
}

/// The screw gear by smaller and larger networks.
pub(super) fn architecture(bench: &Bench<'_>) -> Result<Table> {
    let mut table = Table::of_errors("architecture", "Architecture", &["network", "compared"]);
    table.notes.push(
        "Our screw gear by `single` with other networks. In the paper 5×1024 did not converge in 50 epochs; the labels of \
         MSE and MPE are swapped in its table."
            .into(),
    );
    // Named as at this scale, and by what stands there in the paper.
    let label = |name: &str, recipe: &Recipe| {
        let own = format!("{}×{}", recipe.network.layers, recipe.network.width);
        let papers = name.replace('x', "×");
        if own == papers { own } else { format!("{own} (for {papers})") }
    };
    sweep(bench, "architecture", ReferencePart::ScrewGear, label, table)
}

/// True where both train the same network on the same samples and evaluate it alike, whatever they are called.
fn same_training(one: &Source, other: &Source) -> Result<bool> {
    let unnamed = |source: &Source| -> Result<Recipe> {
        let recipe = source.recipe()?;
        Ok(Recipe { name: String::new(), about: String::new(), variants: Vec::new(), ..recipe })
    };
    Ok(unnamed(one)? == unnamed(other)?)
}

fn sweep(
    bench: &Bench<'_>,
    name: &str,
    part: ReferencePart,
    label: impl Fn(&str, &Recipe) -> String,
    mut table: Table,
) -> Result<Table> {
    let single = bench.protocol.recipe("single", Some(part.name()))?;
    for (variant, source) in bench.protocol.recipe(name, None)?.variants()? {
        let recipe = source.recipe()?;
        // One of the variants may be the training of the table of the parts.
        let training = if same_training(&source, &single)? {
            bench.trained(part, "single")?
        } else {
            bench.run(&format!("{name}-{variant}"), &source)?
        };
        let papers = PAPER.sweep.get(&variant);
        // Two sections stand before the two IMFs.
        let paper = |index: usize| papers.and_then(|papers| papers.get(index.checked_sub(2)?).copied());
        let evaluation_sets = EvaluationSets::of(&recipe)?;
        table.add_training(&[&label(&variant, &recipe)], (&training, None), &evaluation_sets, paper, None)?;
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use imf_fields::recipe::Precision;

    use super::*;
    use crate::paper::PaperScale;
    use crate::paper::protocol::Protocol;

    #[test]
    fn a_variant_that_single_is_already_is_not_trained_again() {
        for (scale, again) in
            [(PaperScale::Full, true), (PaperScale::Reduced, true), (PaperScale::Tiny, false)]
        {
            let protocol = Protocol::new(scale, Precision::F32).unwrap();
            for (name, part, same) in
                [("sparsity", "teapot", "35-percent"), ("architecture", "screw-gear", "5x512")]
            {
                let single = protocol.recipe("single", Some(part)).unwrap();
                for (variant, source) in protocol.recipe(name, None).unwrap().variants().unwrap() {
                    let expected = again && variant == same;
                    assert_eq!(same_training(&source, &single).unwrap(), expected, "{variant}");
                }
            }
        }
    }
}
