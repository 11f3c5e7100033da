// Parameters of a tool, a struct of doubles, by their names.
#ifndef TRUTH_FIELDS_HPP
#define TRUTH_FIELDS_HPP

#include <cmath>
#include <cstddef>
#include <cstring>

namespace truth {

template <class Owner> struct Field {
    const char *name;
    double Owner::*member;
};

// Address of a parameter by its name, or nullptr.
template <class Owner, std::size_t N>
double *find_field(const Field<Owner> (&fields)[N], Owner &owner, const char *name) {
    for (const Field<Owner> &field : fields) {
        if (std::strcmp(field.name, name) == 0) {
            return &(owner.*field.member);
        }
    }
    return nullptr;
}

// Set the parameter at an address; -1 where there is none, else 0.
inline int set_member(double *member, double value) {
    if (member == nullptr) {
        return -1;
    }
    *member = value;
    return 0;
}

// Value of the parameter at an address; nan where there is none.
inline double member_value(const double *member) {
    return member != nullptr ? *member : std::nan("");
}

}  // namespace truth

#endif
