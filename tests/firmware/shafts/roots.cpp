// Square roots of the numbers on stdin, by the core.
#include <iostream>

#include "contid_due/src/core/fixed.h"

int main() {
  uint64_t value;
  while (std::cin >> value) std::cout << contid::square_root(value) << "\n";
}
