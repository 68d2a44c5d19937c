//! What `--help` teaches beyond the arguments.

pub const EXAMPLES: &str = "\
Examples:
  koehler run pipelines/citation/pipeline.toml      from logs to fits and a report
  koehler inspect logs/flight-01.mcap               what is in a log
  koehler init logs/*.mcap                          start a campaign of your own
See `koehler --help` for exit codes and the files of a campaign, `koehler <COMMAND> --help` for each command.";

pub const LONG: &str = "\
The files of a campaign:
  pipeline.toml     what to do: stages, which models, which fits
  channels.toml     which topic and field of a log is which signal, in which unit
  aircraft.toml     constants with unit, sd and source
  *.model.toml      models: equations, parameters, outputs
  campaign.toml     optional: a simulated campaign that makes the logs
  design.toml       optional: a study of inputs that could be flown

A first contact with your own logs:
  koehler inspect logs/flight-01.mcap     see topics, fields and rates
  koehler init logs/*.mcap --out mine     write a starter folder
  (complete mine/channels.toml and mine/pipeline.toml)
  koehler check mine/pipeline.toml        every mistake at once, with file, line and column
  koehler run mine/pipeline.toml          tables in mine/out/, the report in mine/out/report/index.html

Where results come from (docs/provenance.md):
  koehler status mine/pipeline.toml                     what is fresh, stale or missing
  koehler explain mine/pipeline.toml estimate NAME      why, with old and new values of settings
  koehler verify mine/pipeline.toml                     is every file as the run left it?
  koehler lineage mine/out/fits/part-0.parquet          from a table back to the logs
  koehler diff before after                             what moved between two runs
  koehler gc mine/pipeline.toml                         remove what nothing needs

What is in them (docs/tables.md):
  koehler sql mine/pipeline.toml \"SELECT * FROM fits\"   a query in SQL over the tables of a run

What is said:
  --quiet says answers, warnings and errors alone, --verbose each unit of work as well. With --json standard output is one JSON document
  and nothing else; what could not be done is in its `errors`, and always on standard error. NO_COLOR=1 takes the colours away.
  Where standard error is no terminal, a run of more than some seconds says about every ten on it how far the stage is that runs, and what of
  it is left; on a terminal the bar does. --quiet says neither.

Exit codes:
  0  everything asked for is there
  1  the run ended, and something asked for is missing (it is named on the screen and in the table `notes`), or the report calls
     something a problem (it is printed as well); files are not as they were recorded (verify); two runs differ (diff)
  2  nothing could be done: a mistake in the command, the configuration, or the output folder; no log has what the channel map names;
     or standard output could not be written, on a full disk for example (a reader who closes the pipe, as `head` does, is no failure)
  3  a diagnosis found that a model lacks something";

pub const RUN: &str = "\
Each table becomes a Parquet dataset OUT/<table>/, by flight where it is per flight. A stage whose inputs, settings and program are
unchanged is not run again. A run can be stopped at any time: files are written whole or not at all. A folder that is not empty and was not
made by koehler is taken only with --force: files of others that have the names of results are removed.

Examples:
  koehler run pipelines/citation/pipeline.toml
  koehler run pipelines/citation/pipeline.toml --out trial --jobs 4
  koehler run pipelines/citation/pipeline.toml --dry-run
  koehler run pipelines/citation/pipeline.toml --flight flight-1 --until segment     quick trials of settings on one flight
  koehler run pipelines/citation/pipeline.toml --from page                           the report again
  koehler run pipelines/citation/pipeline.toml --json --quiet                        for scripts

A part of a run leaves everything else as it is, stale or fresh, and says so; the next run without these options makes up for it. --until
ends after a stage. --flight takes these flights alone through the stages of single flights; what takes all flights together (estimates
over several flights, lines, the report) is not run. --from runs a stage and those behind it again although they are fresh. They go together.

What a [[diagnose]] section found stands in a box at the end. It is a result and leaves the exit code alone; `koehler diagnose`
ends with 3 where a model lacks something.

Exit codes: 0 everything is there, 1 something asked for is missing or the report names a problem, 2 configuration or usage error.";

pub const DIAGNOSE: &str = "\
Runs the pipeline as far as it is not fresh, and diagnoses the models of its [[diagnose]] sections (without any: of all estimates).
The verdict: named (an effect, with its parameters), one of these (the flights cannot separate them), located but unexplained, nothing
missing but turbulence, nothing missing but noise of records (that drives the model), nothing missing. OUT/models/NAME.next.model.toml is the
model with what was found; tables: findings, candidates, additions, held_out, located.

Examples:
  koehler diagnose pipelines/attas/diagnosis.toml --estimate a-all
  koehler diagnose pipelines/hfb320/pipeline.toml --predicted

Exit codes: 0 nothing is missing, or nothing but turbulence or noise of records; 1 no verdict, or something asked for is missing; 2 configuration or usage error; 3 a model lacks something.";

pub const STATUS: &str = "\
For each stage and flight: fresh, or what changed (a setting, an input, the program, an output file). `koehler explain` says more of one.
--json has the same as `units`, each with `stage`, `unit`, `state` and `reasons`; `to_run` is how many a run would take, `may_run` how many more at
most: those that are run where what they read comes out as another. A unit that failed is tried again by every run; that it fails again is
expected, and what goes on without it is told as that.

Examples:
  koehler status pipelines/citation/pipeline.toml
  koehler status pipelines/citation/pipeline.toml --json | jq .to_run";

pub const EXPLAIN: &str = "\
The first two words of a line of `koehler status` name a unit; its first word alone, all units of a stage. What waits for others is followed
back to where the change began. Lines of a model's text are told one by one.

Examples:
  koehler status pipelines/citation/pipeline.toml
  koehler explain pipelines/citation/pipeline.toml estimate elevator
  koehler explain pipelines/citation/pipeline.toml derive
  koehler explain pipelines/citation/pipeline.toml

A folder that an earlier koehler made has hashes of settings and no values: that a setting changed is told, and not what it was. The next
run adds the values to the records of what it finds fresh.";

pub const DIFF: &str = "\
A parameter has moved where its values differ by more than twice the larger of its two standard deviations (`sd` of the tables, without what
constants add); slope and intercept of a line likewise. One without sd (it is held, or did not converge) has moved where it is not the same
number. Verdicts are those of validation and diagnosis, and why an estimate stopped. What one run alone has is told as well.

Examples:
  koehler run mine/pipeline.toml --out before
  (edit mine/pipeline.toml)
  koehler run mine/pipeline.toml --out after
  koehler diff before after
  koehler diff before after --json > differences.json

Exit codes: 0 no differences, 1 some, 2 a folder has no results that can be read.";

pub const SQL: &str = "\
Every table of the output folder is one table of SQL, whatever the number of its files, and the flight is a column of it; docs/tables.md has
all columns. Only the tables and columns that the query wants are read. Rows come in no certain order without ORDER BY. SHOW TABLES lists
the tables of the run.

The answer has six digits of a number; --csv and --json have all of them. What has no value is null, in CSV empty.

Examples:
  koehler sql mine/pipeline.toml \"SELECT flight, kind, count(*) AS n FROM segments WHERE included GROUP BY flight, kind ORDER BY flight\"
  koehler sql mine/out --csv \"SELECT e.segment, e.value, e.sd, c.value AS V FROM estimates e JOIN conditions c ON e.segment = c.segment
    WHERE e.parameter = 'C_m_alpha' AND c.signal = 'V'\" > points.csv

Exit codes: 0 the query was answered, 2 it could not be.";

pub const LINEAGE: &str = "\
From the file back to the logs: which stages made it and what they read, with the version of the program and a hash of its sources, the
values of their settings (long ones are cut and empty ones left out; --json has all of them), the logs with their hashes and what was kept of
them, and the settings files of the last run. The records alone are read: nothing is run, and the pipeline file may be elsewhere.

Examples:
  koehler lineage pipelines/citation/out/fits/part-0.parquet
  koehler lineage pipelines/citation/out/report/index.html
  koehler lineage pipelines/citation/out/estimates --json";

pub const GC: &str = "\
What goes: tables, files and records of flights, estimates, fits and other units that the pipeline file has no more, and what runs left that
were stopped. What a command asked for (`koehler diagnose`) stays as long as the campaign has it; files of others stay. `koehler run` removes
the same before it works.

Examples:
  koehler gc pipelines/citation/pipeline.toml --dry-run
  koehler gc pipelines/citation/pipeline.toml";

pub const VERIFY: &str = "\
One line for each file that differs from its record, is missing, cannot be read, or that no record names. Every byte is read: sizes and times
are not taken for it. The records are those of the last run; a run makes again what differs or is missing.

Example:
  koehler verify pipelines/citation/pipeline.toml

Exit codes: 0 every file is as recorded, 1 some are not, 2 there is no record.";

pub const CHECK: &str = "\
Every mistake is told at once, with file, line and column. Of the logs only the summary section at the end of each is read (what topics there
are, and what their schemas say of fields and units); `koehler run` does the same before it begins. --json has the mistakes as `errors`, each
with `place` (file, line, column), `what` and `help`.

Examples:
  koehler check pipelines/citation/pipeline.toml
  koehler check pipelines/citation/pipeline.toml --json";

pub const INSPECT: &str = "\
Reads the whole log. --json has `topics` with `fields`, their rates, gaps, counts and ranges, and `notes` on what is damaged or lost.

Examples:
  koehler inspect logs/flight-01.mcap
  koehler inspect logs/flight-01.mcap --json";

pub const INIT: &str = "\
Example:
  koehler init logs/*.mcap --out my-campaign
  (edit my-campaign/channels.toml, my-campaign/pipeline.toml)
  koehler check my-campaign/pipeline.toml";

pub const IMPORT: &str = "\
docs/import.md says what stands in a description. An input is never written over, a file that is no log of koehler's only with --force.

Example:
  koehler import pipelines/hfb320/import.toml";

pub const SIMULATE: &str = "\
Writes the logs that are not there, and those that were simulated before the campaign, its truth model or its constants were changed; all
of them with --force. `koehler run` makes missing ones by itself for a pipeline file with `simulate = \"campaign.toml\"`, and says which
are outdated.

Example:
  koehler simulate pipelines/citation/campaign.toml";

pub const DESIGN: &str = "\
A study file names a simulated campaign (its truth model flies, its sensors record), the models that are estimated, and designs: kind, unit
times, amplitudes, polarities, repeats; a list stands for one design each. Every design is flown once and recorded `seeds` times, each time
with new noise, and every recording is estimated. The designs are ranked by the trace of the Cramer-Rao bound, smallest first, or
by the squared error where that is beyond what the trace promises; one that
leaves a parameter undetermined comes last. OUT/designs/ has, per estimate and design: estimates, errors, scatter between recordings,
standard deviations, trace, determinant, and how far airspeed, attitude, load factor, angle of attack and servo current went.

With `optimise = true` and a [search] section, durations of alternating steps are searched within limits of these excursions.

Examples:
  koehler design pipelines/citation/design.toml
  koehler design pipelines/citation/design.toml --out trial --jobs 2
docs/design.md says what stands in a study file, and how to read the ranks.

Exit codes: 0 every design was flown, 1 some could not be flown (each is named with its line; the others are ranked), 2 configuration or
usage error.";

pub const SCHEMA: &str = "\
Examples:
  koehler schema pipeline               print the schema of pipeline.toml
  koehler schema effect                 that of an effect file
  koehler schema --out schemas          write all of them
An editor completes and checks a file that begins with a line such as
  #:schema ./schemas/pipeline.schema.json";
