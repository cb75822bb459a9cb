//! A report's charts by round: contributions, refusals' reasons, credits and losses.

use crate::report::history::{History, LossHistory, RoundHistory};
use crate::report::page::HtmlPage;
use crate::report::public_losses::PublicLosses;
use crate::report::svg::{lines, lying, stacked, PlotAxis, Series, BAD, COLOURS, GOOD};

/// Most bars or points in a chart. With more rounds, each stands for several.
const MOST_PLACES: usize = 120;

/// Nodes with their own line. The others share one.
const MOST_NODES: usize = 7;

impl HtmlPage {
    /// All charts, if a round was opened.
    pub fn charts(&mut self, history: &History) {
        if history.rounds.is_empty() {
            return;
        }
        self.heading("Charts");
        self.markup("<div class=\"charts\">");
        let groups = groups(&history.rounds);
        let rounds = PlotAxis {
            name: "round",
            places: groups.iter().map(|group| label(group)).collect(),
        };
        let sum = |of: fn(&RoundHistory) -> u64| -> Vec<Option<f64>> {
            let sum = |group: &&[RoundHistory]| Some(group.iter().map(of).sum::<u64>() as f64);
            groups.iter().map(sum).collect()
        };
        let decided = [
            Series {
                name: "accepted".into(),
                colour: GOOD,
                values: sum(|round| round.accepted),
            },
            Series {
                name: "refused".into(),
                colour: BAD,
                values: sum(|round| round.refused),
            },
        ];
        self.figure(
            "Contributions per round",
            &stacked(
                "Contributions per round, accepted and refused",
                &rounds,
                "contributions",
                &decided,
            ),
        );
        self.reasons(history);
        let (name, series) = credits(history, &groups);
        self.figure(&name, &lines(&name, &rounds, "credits", &series, true));
        let loss = |of: fn(&LossHistory) -> f64| -> Vec<Option<f64>> {
            groups.iter().map(|group| mean_loss(group, of)).collect()
        };
        let (before, after) = (loss(|losses| losses.before), loss(|losses| losses.after));
        if before.iter().any(Option::is_some) {
            let losses = [
                Series {
                    name: "global weights".into(),
                    colour: COLOURS[0],
                    values: before,
                },
                Series {
                    name: "updates".into(),
                    colour: COLOURS[2],
                    values: after,
                },
            ];
            let name = "Proven loss of each round's global weights and of the accepted updates, mean over the claims";
            self.figure(
                name,
                &lines(name, &rounds, "loss (mean squared error)", &losses, false),
            );
        } else {
            self.markup("<p class=\"small\">No accepted claim discloses its losses.</p>");
        }
        self.public_losses(&groups, &rounds);
        self.markup("</div>");
    }

    /// The losses on the public samples. Of several rounds in one place, the last.
    fn public_losses(&mut self, groups: &[&[RoundHistory]], rounds: &PlotAxis<'_>) {
        let last = |of: fn(&PublicLosses) -> Option<f64>| -> Vec<Option<f64>> {
            let last = |group: &&[RoundHistory]| {
                let mut rounds = group.iter().rev();
                rounds.find_map(|round| round.public.as_ref().and_then(of))
            };
            groups.iter().map(last).collect()
        };
        let series = [
            ("base", COLOURS[0], last(|public| public.base)),
            (
                "result, taken",
                COLOURS[2],
                last(|public| public.result.filter(|_| public.taken)),
            ),
            (
                "not taken",
                COLOURS[1],
                last(|public| public.result.filter(|_| !public.taken)),
            ),
        ];
        let series = series.map(|(name, colour, values)| Series {
            name: name.into(),
            colour,
            values,
        });
        if series
            .iter()
            .any(|one| one.values.iter().any(Option::is_some))
        {
            let name =
                "Loss of each round's base and of its result on the network's public samples";
            self.figure(
                name,
                &lines(name, rounds, "loss (mean squared error)", &series, false),
            );
        }
    }

    fn reasons(&mut self, history: &History) {
        let accepted: u64 = history.rounds.iter().map(|round| round.accepted).sum();
        let mut bars = vec![("accepted".to_owned(), accepted as f64, GOOD)];
        let mut refusals: Vec<_> = history.refusals.iter().collect();
        refusals.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
        for (reason, count) in refusals {
            bars.push(((*reason).to_owned(), *count as f64, BAD));
        }
        let name = "Contributions by decision and reason";
        self.figure(
            name,
            &lying(name, "decision or reason", "contributions", &bars),
        );
    }
}

/// The rounds, in as many equal groups as a chart shows.
fn groups(rounds: &[RoundHistory]) -> Vec<&[RoundHistory]> {
    rounds
        .chunks(rounds.len().div_ceil(MOST_PLACES).max(1))
        .collect()
}

fn label(group: &[RoundHistory]) -> String {
    match (group.first(), group.last()) {
        (Some(first), Some(last)) if first.round != last.round => {
            format!("{}–{}", first.round, last.round)
        }
        (Some(first), _) => first.round.to_string(),
        _ => String::new(),
    }
}

/// The mean over a group's claims.
fn mean_loss(group: &[RoundHistory], of: fn(&LossHistory) -> f64) -> Option<f64> {
    let losses = || group.iter().filter_map(|round| round.losses.as_ref());
    let claims: u64 = losses().map(|losses| losses.claims).sum();
    let sum: f64 = losses().map(|one| of(one) * one.claims as f64).sum();
    (claims > 0).then(|| sum / claims as f64)
}

/// The nodes' earnings after each group of rounds. The highest have their own lines.
fn credits(history: &History, groups: &[&[RoundHistory]]) -> (String, Vec<Series<'static>>) {
    let mut order: Vec<usize> = (0..history.nodes.len())
        .filter(|place| history.nodes[*place].credits > 0)
        .collect();
    order.sort_by_key(|place| std::cmp::Reverse(history.nodes[*place].credits));
    let named: Vec<usize> = order.iter().copied().take(MOST_NODES).collect();
    let mut totals = vec![0u64; named.len() + 1];
    let mut values: Vec<Vec<Option<f64>>> = vec![Vec::new(); named.len() + 1];
    for group in groups {
        for share in group.iter().flat_map(|round| &round.shares) {
            let line = named.iter().position(|place| *place == share.node);
            let total = &mut totals[line.unwrap_or(named.len())];
            *total = total.saturating_add(share.credits);
        }
        for (line, total) in values.iter_mut().zip(&totals) {
            line.push(Some(*total as f64));
        }
    }
    let others = values.pop().filter(|_| order.len() > named.len());
    let series = named.iter().zip(values).enumerate();
    let mut series: Vec<_> = series
        .map(|(at, (place, values))| Series {
            name: history.nodes[*place].name.clone(),
            colour: COLOURS[at % COLOURS.len()],
            values,
        })
        .collect();
    series.extend(others.map(|values| Series {
        name: "all others".into(),
        colour: COLOURS[7],
        values,
    }));
    (
        "Credits of each node, summed over the rounds so far".into(),
        series,
    )
}
