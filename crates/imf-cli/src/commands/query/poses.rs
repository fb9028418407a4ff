//! Poses as tables: columns by name, in any order, with others among them, separated by commas, semicolons or tabs. A
//! line with an invalid pose is reported, and the others are read; a line with other columns than the first refuses the
//! file. Messages name the line and the column.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Error as IoError, ErrorKind as IoErrorKind, Read, Seek as _, stdin};
use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};
use csv::{ErrorKind, Reader, ReaderBuilder, StringRecord, Trim};
use glam::DVec3;
use imf_core::orientation::Orientation;
use imf_core::pose::Pose;
use imf_core::toolpath::column_remedy;

const POSITION: [&str; 3] = ["x", "y", "z"];
const VECTOR: [&str; 3] = ["i", "j", "k"];
const ANGLES: [&str; 2] = ["theta", "phi"];
const ROLL: [&str; 2] = ["roll", "psi"];

/// Where the tool's direction stands in a line.
enum Direction {
    /// Along +z: there are no columns but the position's.
    Upright,
    /// Tool axis from tip to holder, of any length.
    Vector([usize; 3]),
    /// θ and φ in degrees.
    Angles([usize; 2]),
}

/// Poses from wherever they come.
pub(super) type Poses = PoseReader<Box<dyn Read>>;

/// The poses of a file, all of which were checked, and their number; those of a pipe or of standard input as they come.
///
/// # Errors
/// A file that cannot be read, the first line of it with other columns, and a file of invalid poses alone.
pub(super) fn open(path: &Path) -> Result<(Poses, Option<u64>)> {
    let (input, count, name): (Box<dyn Read>, _, _) = if path.as_os_str() == "-" {
        (Box::new(stdin().lock()), None, "standard input".to_owned())
    } else {
        let name = path.display().to_string();
        let fail = || format!("cannot read the poses {name}");
        let mut file = File::open(path).with_context(fail)?;
        let metadata = file.metadata().with_context(fail)?;
        if metadata.is_dir() {
            return Err(IoError::from(IoErrorKind::IsADirectory)).with_context(fail);
        }
        let mut count = None;
        // A pipe can be read only once.
        if metadata.is_file() {
            count = Some(PoseReader::new(&file, name.clone())?.count()?);
            file.rewind().with_context(fail)?;
        }
        (Box::new(file), count, name)
    };
    Ok((PoseReader::new(input, name)?, count))
}

pub(super) struct PoseReader<R> {
    reader: Reader<BufReader<R>>,
    name: String,
    pub(super) header: StringRecord,
    position: [usize; 3],
    direction: Direction,
    /// ψ in degrees.
    pub(super) roll: Option<usize>,
    waiting: StringRecord,
    /// Among the poses that were read.
    pub(super) invalid: Invalid,
}

/// Lines read whose pose is invalid.
#[derive(Default)]
pub(super) struct Invalid {
    pub(super) count: u64,
    /// The first one's line, and what is wrong with it.
    pub(super) first: String,
}

impl<R: Read> PoseReader<R> {
    /// Reads the header; `name` is what messages call the input.
    ///
    /// # Errors
    /// No header, or one that lacks columns or has both kinds of direction.
    pub(super) fn new(input: R, name: String) -> Result<Self> {
        let mut input = BufReader::new(input);
        let beginning = input.fill_buf().with_context(|| format!("cannot read {name}"))?;
        ensure!(
            !beginning.starts_with(b"\xff\xfe") && !beginning.starts_with(b"\xfe\xff"),
            "{name} is text in UTF-16: save it as UTF-8"
        );
        let first = beginning.split(|&byte| byte == b'\n').next().unwrap_or_default();
        let separator = [b';', b'\t'].into_iter().find(|separator| first.contains(separator)).unwrap_or(b',');
        let mut reader = ReaderBuilder::new().delimiter(separator).trim(Trim::All).from_reader(input);
        let header = reader.headers().map_err(|error| explain(&name, &error))?.clone();
        ensure!(
            !header.is_empty(),
            "{name} is empty; its first line must be x,y,z,i,j,k or x,y,z,theta,phi, or x,y,z alone"
        );
        let find = |column: &str| -> Result<Option<usize>> {
            let mut found = header.iter().enumerate().filter(|(_, title)| title.eq_ignore_ascii_case(column));
            let first = found.next().map(|(index, _)| index);
            ensure!(found.next().is_none(), "{name}, line 1: there is more than one column {column}");
            Ok(first)
        };
        let need = |column: &str| -> Result<usize> {
            find(column)?.with_context(|| {
                let known = header.iter().find_map(|title| column_remedy(&title.to_ascii_lowercase()));
                let columns = header.iter().collect::<Vec<_>>().join(",");
                let what = known.unwrap_or_else(|| {
                    format!(
                        "there is no column {column} in '{columns}'; the first line must name x,y,z,i,j,k or x,y,z,theta,phi, or x,y,z and no other column where the tool is upright"
                    )
                });
                format!("{name}, line 1: {what}")
            })
        };
        let all3 =
            |names: [&str; 3]| Ok::<_, anyhow::Error>([need(names[0])?, need(names[1])?, need(names[2])?]);
        let any = |names: &[&str]| -> Result<bool> {
            names.iter().try_fold(false, |any, column| Ok(any || find(column)?.is_some()))
        };
        let position = all3(POSITION)?;
        let direction = match (any(&VECTOR)?, any(&ANGLES)?) {
            (true, true) => bail!(
                "{name}, line 1: it names both i,j,k and theta,phi; rename the columns that shall not be read"
            ),
            (true, false) => Direction::Vector(all3(VECTOR)?),
            // As in a toolpath.
            (false, false) if header.len() == POSITION.len() => Direction::Upright,
            (false, _) => Direction::Angles([need(ANGLES[0])?, need(ANGLES[1])?]),
        };
        let roll = match (find(ROLL[0])?, find(ROLL[1])?) {
            (Some(_), Some(_)) => bail!("{name}, line 1: roll and psi are one angle; rename one of them"),
            (roll, psi) => roll.or(psi),
        };
        let (waiting, invalid) = (StringRecord::new(), Invalid::default());
        Ok(Self { reader, name, header, position, direction, roll, waiting, invalid })
    }

    /// Replaces `records` and `poses` by the next lines, at most `most`, by none at the end; `None` is an invalid one.
    ///
    /// # Errors
    /// The first line with other columns than the header.
    pub(super) fn read(
        &mut self,
        most: usize,
        records: &mut Vec<StringRecord>,
        poses: &mut Vec<Option<Pose>>,
    ) -> Result<()> {
        records.clear();
        poses.clear();
        while poses.len() < most && self.advance()? {
            poses.push(self.waiting_pose());
            records.push(self.waiting.clone());
        }
        Ok(())
    }

    /// Checks every pose.
    fn count(mut self) -> Result<u64> {
        let mut count = 0;
        while self.advance()? {
            self.waiting_pose();
            count += 1;
        }
        self.invalid.check(count)?;
        Ok(count)
    }

    /// The next line, which stays until the one after it is read.
    fn advance(&mut self) -> Result<bool> {
        self.reader.read_record(&mut self.waiting).map_err(|error| explain(&self.name, &error))
    }

    fn waiting_pose(&mut self) -> Option<Pose> {
        match self.pose(&self.waiting) {
            Ok(pose) => Some(pose),
            Err(error) => {
                if self.invalid.count == 0 {
                    self.invalid.first = format!("{error:#}");
                }
                self.invalid.count += 1;
                None
            }
        }
    }

    fn pose(&self, record: &StringRecord) -> Result<Pose> {
        let line = record.position().map_or(0, csv::Position::line);
        let number = |column: usize| -> Result<f64> {
            let (text, title) = (&record[column], &self.header[column]);
            match text.parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(value),
                _ => bail!("{}, line {line}, column {title}: '{text}' is not a finite number", self.name),
            }
        };
        let vector = |columns: [usize; 3]| -> Result<DVec3> {
            Ok(DVec3::new(number(columns[0])?, number(columns[1])?, number(columns[2])?))
        };
        let position = vector(self.position)?;
        let orientation = match self.direction {
            Direction::Upright => Orientation::new(0.0, 0.0),
            Direction::Vector(columns) => {
                Orientation::from_direction(vector(columns)?).with_context(|| {
                    format!("{}, line {line}, columns i,j,k: the direction must not be zero", self.name)
                })?
            }
            Direction::Angles([theta, phi]) => {
                let angle = number(phi)?;
                ensure!(
                    (0.0..=180.0).contains(&angle),
                    "{}, line {line}, column {}: φ must be from 0 to 180 degrees, not {angle}",
                    self.name,
                    &self.header[phi]
                );
                Orientation::new(number(theta)?.rem_euclid(360.0), angle)
            }
        };
        let roll = self.roll.map(number).transpose()?.map_or(0.0, |roll| roll.rem_euclid(360.0));
        Ok(Pose::oriented(position, &Orientation { roll, ..orientation }))
    }
}

impl Invalid {
    /// Refuses a file without a single valid pose.
    pub(super) fn check(&self, all: u64) -> Result<()> {
        ensure!(self.count == 0 || self.count < all, "no line is a pose: {}", self.first);
        Ok(())
    }
}

/// What the reader says, with the input's name and the line.
fn explain(name: &str, error: &csv::Error) -> anyhow::Error {
    let line = error.position().map_or(1, csv::Position::line);
    match error.kind() {
        ErrorKind::UnequalLengths { expected_len, len, .. } => {
            anyhow::anyhow!("{name}, line {line}: it has {len} columns, and the first line {expected_len}")
        }
        ErrorKind::Utf8 { .. } => anyhow::anyhow!("{name}, line {line}: it is not text in UTF-8"),
        ErrorKind::Io(source) => anyhow::anyhow!("cannot read {name}: {source}"),
        _ => anyhow::anyhow!("{name}, line {line}: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Pose>> {
        let mut reader = PoseReader::new(text.as_bytes(), "poses".into())?;
        let (mut records, mut poses, mut all) = (vec![], vec![], vec![]);
        loop {
            reader.read(2, &mut records, &mut poses)?;
            if poses.is_empty() {
                let Invalid { count, first } = &reader.invalid;
                ensure!(*count == 0, "{first}");
                return Ok(all);
            }
            all.extend(poses.drain(..).flatten());
        }
    }

    #[test]
    fn columns_may_stand_in_any_order_between_others() {
        let poses =
            read("name,PHI,z, y ,theta,x\na,6,3,2,372,1\n\"b, c\",0,6,5,-90,4\nd,180,0,0,0,0\n").unwrap();
        assert_eq!(poses.len(), 3);
        assert_eq!(poses[0].position, DVec3::new(1.0, 2.0, 3.0));
        assert_eq!(poses[0].rotation, Orientation::new(12.0, 6.0).quaternion());
        assert_eq!(poses[1].rotation, Orientation::new(270.0, 0.0).quaternion());
        let rolled = read("x,y,z,theta,phi,Roll\n1,2,3,12,6,450\n1,2,3,12,6,-90\n").unwrap();
        for (pose, roll) in rolled.iter().zip([90.0, 270.0]) {
            let orientation = Orientation { roll, ..Orientation::new(12.0, 6.0) };
            assert_eq!(pose.rotation, orientation.quaternion());
        }
        let rolled = read("roll,x,y,z,i,j,k\n30,1,2,3,0,5,0\n").unwrap();
        let orientation = Orientation { theta: 90.0, phi: 90.0, roll: 30.0 };
        assert_eq!(rolled[0].rotation, orientation.quaternion());
        assert_eq!(read("x,y,z\n1,2,3\n").unwrap()[0].axis(), Some(DVec3::Z));
        for separator in [",", ";", "\t"] {
            let text = "\u{feff}x,y,z,i,j,k\r\n1,2,3,0,0,-2\r\n".replace(',', separator);
            assert_eq!(read(&text).unwrap()[0].axis(), Some(DVec3::NEG_Z));
        }
    }

    #[test]
    fn what_is_wrong_is_named_with_line_and_column() {
        for (text, expected) in [
            ("", "poses is empty"),
            ("x,y,z,w\n", "no column theta"),
            ("x,y,i,j,k\n", "no column z"),
            ("x,y,z,i,j\n", "no column k"),
            ("x,y,z,x,i,j,k\n", "more than one column x"),
            ("x,y,z,i,j,k,phi\n", "both i,j,k and theta,phi"),
            ("x,y,z,theta,phi\n1,2,3,4,5\n1,2,nan,4,5\n", "line 3, column z: 'nan' is not a finite number"),
            ("x,y,z,theta,phi\n1,2,inf,4,5\n", "line 2, column z"),
            ("x,y,z,theta,phi\n1,,3,4,5\n", "line 2, column y: '' is not a finite number"),
            ("x,y,z,theta,phi\n1,2,3,4,185\n", "line 2, column phi: φ must be"),
            ("x,y,z,theta,phi\n1,2,3\n", "line 2: it has 3 columns, and the first line 5"),
            ("x,y,z,theta,phi,roll\n1,2,3,4,5,NaN\n", "line 2, column roll: 'NaN' is not a finite number"),
            ("x,y,z,i,j,k,roll\n1,2,3,4,5,6,\n", "line 2, column roll: ''"),
            ("x,y,z,i,j,k,roll,ROLL\n", "more than one column roll"),
            ("x,y,z,i,j,k,roll,psi\n", "roll and psi are one angle"),
            ("x,y,z,A,C\n", "'a' is an angle of a rotary axis"),
            ("x y z\n", "no column x in 'x y z'"),
            ("\u{feff}x;y;z\n1,5;2;3\n", "line 2, column x: '1,5' is not a finite number"),
            ("x,y,z,i,j,k\n1,2,3,0,0,0\n", "line 2, columns i,j,k: the direction must not be zero"),
        ] {
            let message = format!("{:#}", read(text).unwrap_err());
            assert!(message.contains(expected), "{text:?}: {message}");
        }
        // Two lines of four are invalid poses.
        let table = "x,y,z,i,j,k\n1,2,3,0,0,0\n1,2,3,0,0,1\n1,2,oops,0,0,1\n4,5,6,0,0,1\n";
        let mut reader = PoseReader::new(table.as_bytes(), "poses".into()).unwrap();
        let mut poses = vec![];
        reader.read(9, &mut vec![], &mut poses).unwrap();
        assert_eq!(poses.iter().map(Option::is_some).collect::<Vec<_>>(), [false, true, false, true]);
        assert!(reader.invalid.count == 2 && reader.invalid.first.contains("line 2"));
        assert!(reader.invalid.check(4).is_ok() && reader.invalid.check(2).is_err());
        let wide = PoseReader::new(&b"\xff\xfex\0,\0"[..], "poses".into()).err().unwrap().to_string();
        assert!(wide.contains("UTF-16"), "{wide}");
        let binary: &[u8] = b"x,y,z,i,j,k\n1,2,3,0,0,\xff\n";
        let mut reader = PoseReader::new(binary, "poses".into()).unwrap();
        let message = reader.read(9, &mut vec![], &mut vec![]).unwrap_err().to_string();
        assert!(message.contains("line 2: it is not text"), "{message}");
    }
}
