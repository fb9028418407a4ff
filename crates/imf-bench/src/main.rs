//! The laboratory of `imf`: what measures it beside its rivals, makes the paper's tables, and trains by recipes. Not published.
//!
//! ```text
//! cargo run --release -p imf-bench -- access      what of a surface a tool reaches, beside the direct test
//! cargo run --release -p imf-bench -- edits       what a trained network saves at a changed part
//! cargo run --release -p imf-bench -- exact       exact sections beside scipy, and how their cost grows
//! cargo run --release -p imf-bench -- shop        set-ups, stick-outs, a crib of tools, a machine's poses, the stock along a path
//! cargo run --release -p imf-bench -- train       training steps beside PyTorch
//! cargo run --release -p imf-bench -- gpu         what a GPU does beside the CPU
//! cargo run --release -p imf-bench -- query       poses a second beside collision libraries
//! cargo run --release -p imf-bench -- paper       the paper's tables and figures
//! cargo run --release -p imf-bench -- rates       learning rates of the paper's network
//! cargo run --release -p imf-bench -- recipe      trainings in stages and sweeps, by the files in `recipes`
//! ```
//!
//! `examples` has the topology optimisation of the bracket (`simp`), and a part that changes in steps with a field that follows
//! (`redesign`); `python` the rivals and the readers of files that are written in Python, `parry3d` the one in Rust, which
//! stands outside the workspace. Options, messages and exit codes are those of `imf`, whose library ([`imf_cli`]) does the work.

mod access;
mod candidates;
mod cells;
mod document;
mod edits;
mod exact;
mod gpu;
mod interpolation;
mod measurement;
mod paper;
mod planar;
mod prismatic;
mod query;
mod rates;
mod recipe;
mod rivals;
mod shop;
mod train;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use imf_cli::arguments::GlobalArguments;
use imf_cli::arguments::numbers::with_negative_numbers;
use imf_cli::ranks::Rank;
use imf_cli::session::Session;

/// Measures imf beside its rivals, makes the paper's tables, and trains by recipes.
#[derive(Parser)]
#[command(name = "imf-bench", version, mut_subcommands(with_negative_numbers))]
struct Cli {
    #[command(flatten)]
    global: GlobalArguments,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Access(access::AccessArguments),
    Edits(edits::EditsArguments),
    Exact(exact::ExactArguments),
    Gpu(gpu::GpuArguments),
    Paper(paper::PaperArguments),
    Query(query::QueryArguments),
    Rates(rates::RatesArguments),
    Recipe(recipe::RecipeArguments),
    Shop(shop::ShopArguments),
    Train(train::TrainArguments),
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    imf_cli::exit::code_of(false, |rank| run(&cli, rank))
}

fn run(cli: &Cli, rank: Rank) -> anyhow::Result<()> {
    let session = Session::new(&cli.global, rank)?;
    // These keep what is finished; the others end at once.
    let keeps = matches!(
        cli.command,
        Command::Gpu(_) | Command::Paper(_) | Command::Rates(_) | Command::Recipe(_) | Command::Train(_)
    );
    let _keeping = keeps.then(imf_cli::interrupt::stop_cleanly);
    match &cli.command {
        Command::Access(arguments) => access::run(&session, arguments),
        Command::Edits(arguments) => edits::run(&session, arguments),
        Command::Exact(arguments) => exact::run(&session, arguments),
        Command::Gpu(arguments) => gpu::run(&session, arguments),
        Command::Paper(arguments) => paper::run(&session, arguments),
        Command::Query(arguments) => query::run(&session, arguments),
        Command::Rates(arguments) => rates::run(&session, arguments),
        Command::Recipe(arguments) => recipe::run(&session, arguments),
        Command::Shop(arguments) => shop::run(&session, arguments),
        Command::Train(arguments) => train::run(&session, arguments),
    }
}
