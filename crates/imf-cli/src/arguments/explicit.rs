//! Which options were given on the command line, whatever their values.

use anyhow::{Error, Result};
use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Command, FromArgMatches};

use super::clearance::ContactArguments;
use super::scene::SceneArguments;
use crate::exit::WrongArgument;

/// The names of the options given. It must precede the other arguments of a command, which consume their values.
pub(crate) struct ExplicitOptions(Vec<String>);

impl ExplicitOptions {
    /// Whether an argument of this name was given.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.0.iter().any(|given| given == name)
    }

    /// Refuses the first option of a group that was given; `whose` says to what the group belongs, and why it cannot be.
    fn refuse<T: Args>(&self, whose: &str) -> Result<()> {
        let group = T::augment_args(Command::new("group"));
        let mut given = group.get_arguments().filter(|option| self.has(option.get_id().as_str()));
        match given.find_map(|option| option.get_long()) {
            Some(option) => Err(applies_only(option, whose)),
            None => Ok(()),
        }
    }

    /// Refuses the first of the options of these names that was given.
    pub(crate) fn refuse_options(&self, names: &[&str], whose: &str) -> Result<()> {
        match names.iter().find(|name| self.has(name)) {
            Some(name) => Err(applies_only(name, whose)),
            None => Ok(()),
        }
    }

    /// Refuses what describes the scene and the quantity of a new field, and `others`.
    pub(crate) fn refuse_scene(&self, others: &[&str], whose: &str) -> Result<()> {
        self.refuse::<SceneArguments>(whose)?;
        self.refuse::<ContactArguments>(whose)?;
        self.refuse_options(&["quantity"], whose)?;
        self.refuse_options(others, whose)
    }
}

/// Why an option cannot be given here.
pub(crate) fn applies_only(option: &str, whose: &str) -> Error {
    WrongArgument(format!("--{option} applies only to {whose}: leave it out")).into()
}

// By hand: it has no arguments of its own, and looks at those of the others.
impl Args for ExplicitOptions {
    fn augment_args(command: Command) -> Command {
        command
    }

    fn augment_args_for_update(command: Command) -> Command {
        command
    }
}

impl FromArgMatches for ExplicitOptions {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let names = matches.ids().map(clap::Id::as_str);
        let given = names.filter(|name| matches.value_source(name) == Some(ValueSource::CommandLine));
        Ok(Self(given.map(str::to_owned).collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}
