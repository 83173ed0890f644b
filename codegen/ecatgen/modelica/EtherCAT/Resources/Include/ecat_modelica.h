/* The external functions of the Modelica library EtherCAT: the objects of a model and their life. Access
 * to the bus is in the client (ecat_session.h), which FMUs use as well. These headers adapt it to Modelica.
 *
 * Valid C89, static functions only: a Modelica tool may put every external function into a separate
 * translation unit. Therefore nothing is shared through global variables. Older FMU exporters call a
 * constructor twice; the second object only costs memory, because outputs are claimed by the first
 * commit and not by a constructor.
 *
 *     time t:  wait -> reads -> the model -> writes -> commit
 *
 * Tools may evaluate a when-clause more than once at one time. Therefore the first call at a new time
 * takes the sample, and all reads at that time see it. A write only stores its value. The last commit of
 * the slaves of a domain hands all stored values over at once; a second such commit does no harm.
 *
 * A model may run without a bus. Constructors store the expected slaves and entries. The session looks all
 * of them up when there is a bus, and again when the bus has come back.
 *
 * The master owns the memory of all objects, so that they may be destroyed in any order.
 * ModelicaFormatError() does not return: a function that calls it must not hold resources that no object
 * owns.
 */
#ifndef ECAT_MODELICA_H
#define ECAT_MODELICA_H

#include "ecatm_can.h"
#include "ecatm_drive_steps.h"
#include "ecatm_generate.h"
#include "ecatm_master.h"
#include "ecatm_objects.h"
#include "ecatm_outputs.h"
#include "ecatm_realtime.h"
#include "ecatm_samples.h"
#include "ecatm_sdo.h"
#include "ecatm_sdo_list.h"
#include "ecatm_sdo_once.h"

#endif
