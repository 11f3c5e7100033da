// Implementation of log_replay.hpp.
#include "log_replay.hpp"

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <unordered_set>
#include <utility>

#include "edge_counts.hpp"
#include "hal/measured/measured.h"

extern "C" {
#include "hal/hal.h"
}

namespace replay {

namespace {

// A change of trigger or state is in a STATE frame at most this many ticks later: sending a frame
// takes 5 ticks, and other frames may come first.
constexpr int FRAME_ROWS = 12;
// The bridge drives three rows after the tick that begins a drive, and is open two rows after the
// tick that ends it (firmware/drivers/h_bridge.h).
constexpr int DRIVE_ROWS = 3, OPEN_ROWS = 2;
constexpr int CLOSED_EARLY = 2, OPENED_LATE = 10;  // rows
constexpr int DEBOUNCE_ROWS = MEASURED_DEBOUNCE_TICKS;
constexpr int CONTACT_ROWS = 30;  // least number of rows between two changes of the contact
constexpr int TRIGGER_COUNTS = 1024;
constexpr int TRIGGER_MOST = 255;
constexpr int TRIGGER_SHIFT = 7;  // from the travel in Q15 to the signal
constexpr std::uint8_t CONTACT = HAL_SWITCH_CONTACT, REVERSE = HAL_SWITCH_REVERSE;

// A state of the firmware with the inputs that led to it.
struct Particle {
    std::vector<std::uint8_t> firmware;
    std::uint16_t counts = 0;
    std::uint8_t contact = 1;  // drivers/trigger.c: closed until the debouncing has seen it open
    int changed = -CONTACT_ROWS;
    int apart = 0;  // rows since which the state has differed from the log's
};

struct Failure {
    int row;
    const char *signal;
    int expected;
};

// Possible values of the inputs of a tick that its row of the log does not contain.
struct Choices {
    std::vector<int> triggers;  // values of the signal; empty: unchanged
    std::vector<std::uint8_t> edges;
    bool contact_may_change;
    std::uint8_t direction;  // REVERSE or 0
};

int trigger_of(const std::vector<Row> &rows, int row) {
    const int last = static_cast<int>(rows.size()) - 1;
    return rows[static_cast<std::size_t>(std::clamp(row, 0, last))].trigger;
}

std::vector<int> range_of(int first, int last) {
    std::vector<int> values;
    for (int value = std::max(first, 0); value <= std::min(last, TRIGGER_MOST); ++value)
        values.push_back(value);
    return values;
}

// Value between two rows in which the trigger is known, on a straight line.
int between(int first, int last, int at, int length) {
    return first + (last - first) * at / length;
}

// Possible values of the trigger in a row. The log holds the value of the last STATE frame. In a
// row whose value differs from the row before, a frame came and the value is exact. Between two
// such rows the trigger is near the straight line between both values. Where no frame came for
// long, it is within 1 of the last value: a larger change would have sent a frame.
std::vector<int> triggers_at(const std::vector<Row> &rows, int row, int spread) {
    const int now = trigger_of(rows, row);
    if (now == UNKNOWN)
        return row == 0 ? range_of(0, 0) : std::vector<int>{};
    if (trigger_of(rows, row - 1) != now)
        return range_of(now, now);
    int before = row - 1;
    while (before >= row - FRAME_ROWS && trigger_of(rows, before) == now)
        --before;
    for (int next = row + 1; next <= row + FRAME_ROWS; ++next) {
        const int then = trigger_of(rows, next);
        if (then == now)
            continue;
        if (before < row - FRAME_ROWS)
            return range_of(std::min(now, then), std::max(now, then));
        const int value = between(now, then, row - before - 1, next - before - 1);
        return range_of(value - spread, value + spread);
    }
    if (before >= row - FRAME_ROWS)
        return now == 0 || now == TRIGGER_MOST ? range_of(now, now) : range_of(now - 1, now + 1);
    return {};
}

// Whether the trigger's contact may close or open in a row. The log does not contain it, but the
// bridge shows it: it drives while the contact is closed and the travel is above 0. The contact may
// therefore have closed shortly before a drive, at most DEBOUNCE_ROWS after the travel began, and
// may open shortly after it.
bool contact_may_change(const std::vector<Row> &rows, int row) {
    const int last = static_cast<int>(rows.size()) - 1;
    const auto open = [&rows, last](int at) {
        return rows[static_cast<std::size_t>(std::clamp(at, 0, last))].compare == MEASURED_COAST;
    };
    const bool begins = trigger_of(rows, row - DEBOUNCE_ROWS - 1) <= 0;
    for (int at = row + DRIVE_ROWS; begins && at <= row + DRIVE_ROWS + CLOSED_EARLY; ++at)
        if (!open(at) && open(at - 1))
            return true;
    for (int at = row + OPEN_ROWS - OPENED_LATE; at <= row + OPEN_ROWS; ++at)
        if (at > 0 && open(at) && !open(at - 1))
            return true;
    return false;
}

// Direction of the next drive.
std::uint8_t direction_at(const std::vector<Row> &rows, std::size_t row) {
    for (; row < rows.size(); ++row)
        if (rows[row].compare != MEASURED_COAST && rows[row].compare != 0)
            return rows[row].compare < 0 ? REVERSE : 0;
    return 0;
}

// The inputs of a run: rows, choices and start.
class Search {
public:
    Search(const std::vector<Row> &rows, const std::string &eeprom, const Options &options)
        : rows_(rows),
          options_(options) {
        Particle first;
        first.firmware.resize(measured_bytes());
        measured_start(first.firmware.data(),
                       reinterpret_cast<const std::uint8_t *>(eeprom.data()));
        for (int counts = 0; counts < TRIGGER_COUNTS; ++counts)
            add_count(first, counts);
        find_samples(first.firmware);
        particles_.push_back(std::move(first));
        std::vector<SpeedRow> speeds;
        for (const Row &row : rows)
            speeds.push_back({row.speed_rpm_q1, row.compare != MEASURED_COAST});
        edges_ = edge_counts(speeds, options.hall_pulses);
    }

    Result run() {
        std::size_t row = 0;
        for (; row < rows_.size() && !particles_.empty(); ++row)
            step(static_cast<int>(row));
        Result result{static_cast<int>(rows_.size()), "", 0, complete_};
        if (particles_.empty()) {
            const auto longest = std::max_element(
                failures_.begin(), failures_.end(), [this](const Failure &a, const Failure &b) {
                    return a.row != b.row ? a.row < b.row : miss(a) > miss(b);
                });
            result.row = longest->row;
            result.signal = longest->signal;
            result.expected = longest->expected;
        }
        return result;
    }

private:
    // One number of counts for each travel that the firmware distinguishes.
    void add_count(const Particle &start, int counts) {
        const auto count = static_cast<std::uint16_t>(counts);
        const std::uint16_t travel = measured_travel_q15(start.firmware.data(), count);
        std::vector<std::uint16_t> &known = counts_[travel >> TRIGGER_SHIFT];
        if (counts == 0 || travel != travel_)
            known.push_back(count);
        travel_ = travel;
    }

    // The ADC schedule does not depend on the inputs.
    void find_samples(std::vector<std::uint8_t> firmware) {
        const MeasuredInputs rest{0, 0, 18000, 0, 0, 0};
        MeasuredOutputs outputs;
        for (std::size_t row = 0; row <= rows_.size(); ++row) {
            takes_.push_back(measured_takes_trigger(firmware.data()));
            measured_tick(firmware.data(), &rest, &outputs);
        }
    }

    // Ticks to the sample that replaces the travel; 0 where the next sample repeats it.
    std::uint8_t sample_ticks(int row) const {
        int next = row + 1;
        while (next < static_cast<int>(rows_.size()) && !takes_[static_cast<std::size_t>(next)])
            ++next;
        const bool replaces = !triggers_at(rows_, next, options_.spread).empty();
        return static_cast<std::uint8_t>(replaces ? next - row : 0);
    }

    void step(int row) {
        const auto at = static_cast<std::size_t>(row);
        sample_ticks_ = sample_ticks(row);
        const Choices choices{takes_[at] ? triggers_at(rows_, row, options_.spread)
                                         : std::vector<int>{},
                              edges_[at], contact_may_change(rows_, row), direction_at(rows_, at)};
        std::vector<Particle> before;
        before.swap(particles_);
        keys_.clear();
        failures_.clear();
        for (const Particle &particle : before)
            extend(particle, row, choices);
    }

    void extend(const Particle &particle, int row, const Choices &choices) {
        for (const std::uint16_t counts : counts_of(particle, choices))
            for (const std::uint8_t contact : contacts_of(particle, row, choices))
                for (const std::uint8_t edges : choices.edges)
                    advance(particle, row, {counts, contact, edges, choices.direction});
    }

    struct Hidden {
        std::uint16_t counts;
        std::uint8_t contact, edges, direction;
    };

    std::vector<std::uint16_t> counts_of(const Particle &particle, const Choices &choices) const {
        if (choices.triggers.empty())
            return {particle.counts};
        std::vector<std::uint16_t> counts;
        for (const int value : choices.triggers) {
            const auto &known = counts_[static_cast<std::size_t>(value)];
            counts.insert(counts.end(), known.begin(), known.end());
        }
        return counts;
    }

    std::vector<std::uint8_t> contacts_of(const Particle &particle, int row,
                                          const Choices &choices) const {
        if (row < DEBOUNCE_ROWS)
            return {static_cast<std::uint8_t>(row + 1 < DEBOUNCE_ROWS ? CONTACT : 0)};
        if (!choices.contact_may_change || row - particle.changed < CONTACT_ROWS)
            return {particle.contact};
        return {particle.contact, static_cast<std::uint8_t>(particle.contact ^ CONTACT)};
    }

    void advance(const Particle &from, int row, const Hidden &hidden) {
        const Row &given = rows_[static_cast<std::size_t>(row)];
        const MeasuredInputs inputs{static_cast<std::int16_t>(given.current_a_q9),
                                    static_cast<std::int16_t>(given.speed_rpm_q1),
                                    static_cast<std::uint16_t>(given.supply_mv),
                                    hidden.counts,
                                    static_cast<std::uint8_t>(hidden.contact | hidden.direction),
                                    hidden.edges};
        MeasuredOutputs outputs;
        scratch_ = from;
        measured_tick(scratch_.firmware.data(), &inputs, &outputs);
        scratch_.counts = hidden.counts;
        if (hidden.contact != from.contact)
            scratch_.changed = row < DEBOUNCE_ROWS ? -CONTACT_ROWS : row;
        if (row - scratch_.changed >= CONTACT_ROWS)
            scratch_.changed = -CONTACT_ROWS;
        scratch_.contact = hidden.contact;
        if (agrees(scratch_, row, outputs))
            keep();
    }

    void keep() {
        const std::uint64_t counts = sample_ticks_ > 0 ? 0 : scratch_.counts;
        const std::uint64_t key = measured_key(scratch_.firmware.data(), sample_ticks_) ^
                                  (counts << 40) ^
                                  (static_cast<std::uint64_t>(scratch_.changed) << 20) ^
                                  static_cast<std::uint64_t>(scratch_.apart);
        if (!keys_.insert(key).second)
            return;
        if (particles_.size() < options_.most)
            particles_.push_back(scratch_);
        else
            complete_ = false;
    }

    bool fail(int row, const char *signal, int expected) {
        failures_.push_back({row, signal, expected});
        return false;
    }

    int miss(const Failure &failure) const {
        const Row &given = rows_[static_cast<std::size_t>(failure.row)];
        const bool state = failure.signal[0] == 's';
        return std::abs(failure.expected - (state ? given.state : given.compare));
    }

    bool agrees(Particle &particle, int row, const MeasuredOutputs &outputs) {
        const Row &given = rows_[static_cast<std::size_t>(row)];
        if (outputs.compare != given.compare)
            return fail(row, "duty", outputs.compare);
        if (given.state == UNKNOWN)
            return true;
        particle.apart = outputs.state == given.state ? 0 : particle.apart + 1;
        if (particle.apart == 0 || (particle.apart < FRAME_ROWS && !reported(row)))
            return true;
        return fail(row - particle.apart + 1, "state", outputs.state);
    }

    // A STATE frame gives the values of this row.
    bool reported(int row) const {
        if (row == 0)
            return false;
        const Row &now = rows_[static_cast<std::size_t>(row)];
        const Row &last = rows_[static_cast<std::size_t>(row) - 1];
        return now.state != last.state || now.trigger != last.trigger;
    }

    const std::vector<Row> &rows_;
    const Options options_;
    std::vector<std::uint16_t> counts_[TRIGGER_MOST + 1];
    std::uint16_t travel_ = 0;                      // of the last of them
    std::vector<std::vector<std::uint8_t>> edges_;  // possible in each row
    std::vector<bool> takes_;                       // ticks with a sample of the trigger
    std::vector<Particle> particles_;
    Particle scratch_;
    std::uint8_t sample_ticks_ = 0;
    std::unordered_set<std::uint64_t> keys_;
    std::vector<Failure> failures_;
    bool complete_ = true;
};

}  // namespace

Result replay_log(const std::vector<Row> &rows, const std::string &eeprom, const Options &options) {
    return Search(rows, eeprom, options).run();
}

}  // namespace replay
