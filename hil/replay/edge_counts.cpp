// Implementation of edge_counts.hpp.
#include "edge_counts.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdlib>

extern "C" {
#include "hal/hal.h"
}

namespace replay {

namespace {

constexpr double TICK = HAL_CYCLES_PER_TICK;
constexpr double RPM_CYCLES_Q1 = 1.92e9;  // speed in rpm Q1 times period of a turn
constexpr double SLACK = 1.0;             // cycles: stamps are integers
constexpr double RATIO = 2.0;  // of two successive periods, at most: hall_speed.c, is_even
constexpr std::uint8_t EDGES_MOST = 2;
constexpr std::size_t NODES_MOST = 64;

struct Interval {
    double low, high;
    bool empty() const { return low > high; }
};

Interval meet(const Interval &a, const Interval &b) {
    return {std::max(a.low, b.low), std::min(a.high, b.high)};
}

Interval minus(const Interval &a, const Interval &b) {
    return {a.low - b.high, a.high - b.low};
}

// Number of Hall edges since the shaft began to turn: none, one, or more (a speed is known).
enum class Kind { REST, FIRST, TURNS };

// What is known at the end of a tick: age of the last edge, and the last period.
struct Node {
    Kind kind;
    Interval age, period;
};

struct Link {
    std::size_t from, to;
    std::uint8_t edges;
};

class Filter {
public:
    Filter(const std::vector<SpeedRow> &rows, int pulses)
        : rows_(rows),
          factor_(RPM_CYCLES_Q1 / pulses) {
        layers_.push_back({Node{Kind::REST, {0.0, 0.0}, {0.0, 0.0}}});
    }

    std::vector<std::vector<std::uint8_t>> counts() {
        for (std::size_t row = 0; row < rows_.size(); ++row)
            forward(row);
        std::vector<std::vector<std::uint8_t>> result(rows_.size());
        std::vector<bool> alive(layers_.back().size(), true);
        for (std::size_t row = rows_.size(); row-- > 0;)
            alive = backward(row, alive, result[row]);
        return result;
    }

private:
    // Period of a speed that was rounded to nearest, and age of a speed that was rounded down.
    Interval period_of(int speed) const {
        return {factor_ / (speed + 0.5) - SLACK, factor_ / (speed - 0.5) + SLACK};
    }

    Interval age_of(int speed) const {
        return {factor_ / (speed + 1.0) - SLACK, factor_ / speed + SLACK};
    }

    int speed_at(std::size_t row) const { return std::abs(rows_[row].speed_rpm_q1); }

    void forward(std::size_t row) {
        const std::vector<Node> &last = layers_.back();
        next_.clear();
        links_.emplace_back();
        for (std::size_t n = 0; n < last.size(); ++n)
            extend(last[n], n, row);
        if (next_.empty())
            restart(last.size(), speed_at(row));
        layers_.push_back(next_);
    }

    // No number of edges agrees, as after an edge that the firmware has left out: all are possible.
    void restart(std::size_t count, int now) {
        const Node node = now == 0 ? Node{Kind::REST, {0.0, 0.0}, {0.0, 0.0}}
                                   : Node{Kind::TURNS, {0.0, factor_ / now}, {0.0, 1e9}};
        for (std::size_t n = 0; n < count; ++n)
            for (std::uint8_t edges = 0; edges <= EDGES_MOST; ++edges)
                add(node, n, edges);
    }

    void extend(const Node &node, std::size_t n, std::size_t row) {
        const int now = speed_at(row);
        const int before = row > 0 ? speed_at(row - 1) : 0;
        if (node.kind == Kind::REST)
            extend_rest(n, row);
        else if (now == 0)
            extend_still(node, n);
        else
            extend_turning(node, n, now, before);
    }

    void extend_rest(std::size_t n, std::size_t row) {
        if (speed_at(row) != 0)
            return;
        add({Kind::REST, {0.0, 0.0}, {0.0, 0.0}}, n, 0);
        if (rows_[row].driven)
            add({Kind::FIRST, {0.0, TICK}, {0.0, 0.0}}, n, 1);
    }

    void extend_still(const Node &node, std::size_t n) {
        if (node.kind == Kind::FIRST)
            add({Kind::FIRST, {node.age.low + TICK, node.age.high + TICK}, {0.0, 0.0}}, n, 0);
        add({Kind::REST, {0.0, 0.0}, {0.0, 0.0}}, n, 0);  // the timeout has passed
    }

    void extend_turning(const Node &node, std::size_t n, int now, int before) {
        const Interval age{node.age.low + TICK, node.age.high + TICK};
        if (node.kind == Kind::TURNS)
            without_edge(node, age, n, now, before);
        with_edge(age, n, now);
        if (node.kind == Kind::TURNS)
            with_two_edges(node, age, n, now);
    }

    void without_edge(const Node &node, const Interval &age, std::size_t n, int now, int before) {
        if (now > before)
            return;
        const Interval fallen = meet(age, age_of(now));
        if (now < before) {
            if (!fallen.empty())
                add({Kind::TURNS, fallen, node.period}, n, 0);
            return;
        }
        const double most = std::max(node.period.high, factor_ / before) + SLACK;
        const Interval held = meet(age, {0.0, most});
        if (!held.empty())
            add({Kind::TURNS, held, node.period}, n, 0);
    }

    // One edge, at `age` less the period. It states the period unless the speed falls already.
    void with_edge(const Interval &age, std::size_t n, int now) {
        const Interval period = period_of(now);
        const Interval fresh = meet(meet(minus(age, period), {0.0, TICK}), {0.0, period.high});
        if (!fresh.empty())
            add({Kind::TURNS, fresh, period}, n, 1);
        const Interval fallen = meet(age_of(now), {0.0, TICK});
        const Interval shorter = meet(minus(age, fallen), {0.0, fallen.high});
        if (!fallen.empty() && !shorter.empty())
            add({Kind::TURNS, fallen, shorter}, n, 1);
    }

    void with_two_edges(const Node &node, const Interval &age, std::size_t n, int now) {
        const Interval second = period_of(now);
        const Interval first{std::max(node.period.low, second.low / RATIO) / RATIO,
                             std::min(node.period.high, second.high * RATIO) * RATIO};
        const Interval sum{first.low + second.low, first.high + second.high};
        const Interval fresh =
            meet(meet(minus(age, sum), {0.0, TICK - second.low}), {0.0, second.high});
        if (!fresh.empty())
            add({Kind::TURNS, fresh, second}, n, 2);
    }

    // Nodes whose intervals overlap are joined.
    void add(const Node &node, std::size_t from, std::uint8_t edges) {
        std::size_t at = 0;
        while (at < next_.size() && !joins(next_[at], node))
            ++at;
        if (at == next_.size() && at < NODES_MOST)
            next_.push_back(node);
        at = std::min(at, NODES_MOST - 1);
        widen(next_[at].age, node.age);
        widen(next_[at].period, node.period);
        links_.back().push_back({from, at, edges});
    }

    static bool joins(const Node &a, const Node &b) {
        return a.kind == b.kind && !meet(a.age, b.age).empty() && !meet(a.period, b.period).empty();
    }

    static void widen(Interval &known, const Interval &more) {
        known = {std::min(known.low, more.low), std::max(known.high, more.high)};
    }

    std::vector<bool> backward(std::size_t row, const std::vector<bool> &alive,
                               std::vector<std::uint8_t> &counts) const {
        std::vector<bool> before(layers_[row].size(), false);
        for (const Link &link : links_[row]) {
            if (!alive[link.to])
                continue;
            before[link.from] = true;
            if (std::find(counts.begin(), counts.end(), link.edges) == counts.end())
                counts.push_back(link.edges);
        }
        return before;
    }

    const std::vector<SpeedRow> &rows_;
    const double factor_;
    std::vector<std::vector<Node>> layers_;  // one more than rows
    std::vector<std::vector<Link>> links_;
    std::vector<Node> next_;
};

}  // namespace

std::vector<std::vector<std::uint8_t>> edge_counts(const std::vector<SpeedRow> &rows, int pulses) {
    return Filter(rows, pulses).counts();
}

}  // namespace replay
