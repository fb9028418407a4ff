//! A sweep: the variants of a recipe one after the other, and a table of all.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context as _, Result};
use imf_cli::output::{print, print_json, table, write_json, write_text};
use serde::Serialize;

use super::stage::Workshop;
use super::summary::{Summary, loss_chart};
use super::{Run, Scenes, claim, go_on_or_read};
use crate::recipe::Recipe;

/// A variant and what it came to.
#[derive(Serialize)]
struct Line {
    variant: String,
    #[serde(flatten)]
    summary: Summary,
}

pub(super) fn run(
    workshop: &Workshop<'_>,
    whole: &toml::Table,
    runs: &[Run],
    scenes: &mut Scenes,
    out: &Path,
) -> Result<()> {
    let recipe = Recipe::from_table(whole.clone())?;
    claim::take(workshop.session, out, whole)?;
    let mut lines = Vec::new();
    for run in runs {
        let variant = run.variant.clone().context("a sweep without variants")?;
        workshop.session.note(&format!("variant {variant}:"));
        let summary = go_on_or_read(workshop, run, scenes)?;
        lines.push(Line { variant, summary });
    }
    write_json(&out.join("sweep.json"), &lines)?;
    let (head, rows) = cells(&lines);
    write_text(&out.join("sweep.md"), &markdown(&recipe, &head, &rows))?;
    let curves = lines.iter().flat_map(|line| {
        let prefix = if line.summary.stages.len() > 1 { format!("{} ", line.variant) } else { String::new() };
        let mut curves = line.summary.curves(&prefix);
        if let [only] = curves.as_mut_slice() {
            only.name.clone_from(&line.variant);
        }
        curves
    });
    loss_chart(&recipe.name, curves.collect()).save(&out.join("loss.png"))?;
    if workshop.session.json {
        return print_json(&lines);
    }
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    print(&format!(
        "\n{}\n{} holds sweep.md, sweep.json and a folder for each variant.",
        table(&head, &rows),
        out.display()
    ))
}

/// The table's head, and a row for each result of each variant.
fn cells(lines: &[Line]) -> (Vec<String>, Vec<Vec<String>>) {
    let mut head: Vec<String> =
        ["variant", "parameters", "training", "random MSE", "random MPE"].map(String::from).into();
    if let Some(outcome) = lines.iter().find_map(|line| line.summary.results.first()) {
        for answer in outcome.imf() {
            let name = answer.name.split(" (").next().unwrap_or("IMF");
            head.extend([format!("{name} MSE"), format!("{name} MPE")]);
        }
    }
    let mut rows = Vec::new();
    for line in lines {
        for outcome in &line.summary.results {
            let name = if line.summary.results.len() > 1 {
                format!("{} {}", line.variant, outcome.stage)
            } else {
                line.variant.clone()
            };
            let seconds = format!("{:.1} s", line.summary.seconds());
            let mut row = vec![name, outcome.parameters.to_string(), seconds];
            for answer in outcome.random().into_iter().chain(outcome.imf()) {
                row.extend([format!("{:.2e}", answer.errors.mse), format!("{:.4}", answer.errors.mpe)]);
            }
            rows.push(row);
        }
    }
    (head, rows)
}

fn markdown(recipe: &Recipe, head: &[String], rows: &[Vec<String>]) -> String {
    let mut text = format!("# {}\n\n{}\n\n| {} |\n", recipe.name, recipe.about, head.join(" | "));
    let _ = writeln!(text, "| {} |", vec!["---"; head.len()].join(" | "));
    for row in rows {
        let _ = writeln!(text, "| {} |", row.join(" | "));
    }
    text.push_str("\nErrors are against the exact field; random: orientations that training never saw.\n\n");
    text.push_str("![Training loss of every variant](loss.png)\n");
    text
}
